"""What `fogbank reproduce` computes and draws: one module per figure, in parts for measuring and for drawing."""
