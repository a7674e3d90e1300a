"""Where on a course a vehicle was: laps, named areas, and the line it is measured along."""
