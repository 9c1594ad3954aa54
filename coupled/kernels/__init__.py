"""The compiled equations of light, carriers and heat, and the methods that integrate them."""
