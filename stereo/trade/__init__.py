"""Speed against accuracy: ways to render one scene, and what each does to stereo."""
