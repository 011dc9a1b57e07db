"""From the model and a thermal state to the table that a controller adds."""
