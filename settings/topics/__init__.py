"""The declaration of every setting, by topic. ``docs/extend.md`` lists the steps for a new setting."""
