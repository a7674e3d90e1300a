"""What stands beside the roads: buildings, trees, walls, parked cars, and the boxes that sensors see."""
