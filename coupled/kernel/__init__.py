"""Light, carriers and heat in time: the equations, the step and the loop in C++17, and what calls them."""
