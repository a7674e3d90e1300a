"""One plan of one moment, drawn and explained."""
