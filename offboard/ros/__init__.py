"""The robot in a graph of ROS 2: what it publishes becomes ROS's messages, a goal from there an order of a person."""

INSTALL = "Run pip install 'indoor-mapping[ros]' (257 MB), or source the setup file of a ROS 2 installation."
