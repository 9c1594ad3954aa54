"""One self-contained HTML file that computes the dynamics of a ring in the browser."""
