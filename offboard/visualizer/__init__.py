"""The web page: a live map of the floor, with the robot, its path, and the points of interest to click on."""
