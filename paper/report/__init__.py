"""What the scripts share: results and claims, the runner, and the page."""
