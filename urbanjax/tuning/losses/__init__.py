"""What tuning minimises: one file for each kind of loss."""
