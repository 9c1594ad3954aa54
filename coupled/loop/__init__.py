"""Co-simulation with the full-order FEM: a small thermal model predicts, the FEM corrects."""
