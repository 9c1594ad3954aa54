"""Time integration of light, carriers and heat: the equations and the steps in C++17, and their Python interface."""
