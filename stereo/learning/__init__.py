"""Training of stereo networks on icy ground: ray-traced pairs, the network icynet, and its trainer."""

#: Width and height of a made pair in pixels.
CROP_PX = (256, 192)
