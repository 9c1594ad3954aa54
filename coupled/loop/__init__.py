"""FEM in the loop: a small model predicts, the full-order problem corrects."""
