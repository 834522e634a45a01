"""How ice and snow reflect light: laws, albedos, texture maps."""
