"""The declaration of every setting, by topic."""
