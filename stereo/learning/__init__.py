"""Training of stereo networks on icy ground: pairs made by rays, the network icynet, and its trainer."""
