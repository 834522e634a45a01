"""Training of stereo networks on icy ground: pairs made by rays, the network icynet, and its trainer."""

#: Width and height of a made pair in pixels.
CROP_PX = (256, 192)
