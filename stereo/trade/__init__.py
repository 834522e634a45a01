"""Speed against accuracy: ways to render one scene, and the effect of each on stereo."""
