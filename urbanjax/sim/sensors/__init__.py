"""What sensors see of the world, and the furniture of the streets that they see it by."""
