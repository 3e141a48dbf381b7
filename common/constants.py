"""Every physical number of the robot and its rules, in SI units; the specification's own name in the comment.

The firmware keeps its copies in `arduino/indoor_mapping/src/config.h`; an architecture test compares the two.
"""

from math import radians

# Rates
SENSOR_RATE_HZ = 10.0  # K_Sensor_Update_Frequency
POSE_RATE_HZ = 10.0  # K_Pose_Map_Update_Frequency
MAP_RATE_MAX_HZ = 2.0  # k_update_frequency, on change
STATUS_RATE_HZ = 10.0  # k_log_period
BOARD_RATE_HZ = 0.2  # load, temperature and disk of a computer

# Serial line between the Arduino and the bridge, bits per second: one that divides the Arduino's clock exactly
SERIAL_BAUD = 250_000

# Speeds and turning
SPEED_MEDIUM_M_S = 0.16  # k_medium_speed, ENUM_SPEED.MEDIUM, K_system_Speed
SPEED_HIGH_M_S = 0.50  # k_high_speed, ENUM_SPEED.HIGH: as requested; the Carrier clamps to the motor limit
SPEED_LIMIT_M_S = 0.30  # c_left_motor_speed, c_right_motor_speed: what a motor reaches
SPEED_ERROR_M_S = 0.01  # k_speed_error
ANGLE_ERROR_RAD = radians(1.0)  # k_angle_error
TURN_ON_SPOT_RAD = radians(15.0)  # larger changes of heading are made standing, and end with Completed

# Distances, from the footprint unless stated otherwise
SAFE_DISTANCE_M = 0.05  # k_safe_distance: nearer than this the Carrier backs off
PLANNER_CLEARANCE_M = 0.12  # what the Planner keeps
MIN_DISTANCE_TO_WALL_M = 1.00  # k_min_dist_to_wall
MIN_DISTANCE_POI_M = 1.50  # k_min_dist_POI
HALL_WIDTH_FOR_BOTH_M = MIN_DISTANCE_TO_WALL_M + MIN_DISTANCE_POI_M  # narrower halls are driven in the middle

# Body
FOOTPRINT_RADIUS_M = 0.22
WHEEL_DIAMETER_M = 0.066
WHEEL_TRACK_M = 0.30
ENCODER_TICKS_PER_TURN = 1440
TICK_M = 3.141592653589793 * WHEEL_DIAMETER_M / ENCODER_TICKS_PER_TURN

# Sonars: ranges count from the centre of the ring, which is the centre of the footprint
SONAR_COUNT = 5
SONAR_NAMES = ("left", "front_left", "front", "front_right", "right")
SONAR_BEARINGS_RAD = (radians(90.0), radians(45.0), 0.0, radians(-45.0), radians(-90.0))  # left positive
SONAR_LEFT, SONAR_FRONT_LEFT, SONAR_FRONT, SONAR_FRONT_RIGHT, SONAR_RIGHT = range(SONAR_COUNT)
SONAR_RING_RADIUS_M = 0.07
SONAR_MIN_M = 0.1524  # 6 inches, from the transducer: nearer things read as this
SONAR_MAX_M = 6.4516  # 254 inches
SONAR_STEP_M = 0.0254  # 1 inch
SONAR_AGE_MAX_S = 0.25
SONAR_RANGE_MIN_M = SONAR_RING_RADIUS_M + SONAR_MIN_M  # from the ring's centre: a reading pegged here is contact

# Battery: at this voltage it counts as empty, with what a board needs to end in order still in it
BATTERY_LOW_V = 10.5

# Camera
CAMERA_FIELD_OF_VIEW_RAD = 0.94  # k_max_AOV_POI
CAMERA_RANGE_M = 2.5  # how far a wall counts as imaged
CAMERA_INCIDENCE_MAX_RAD = radians(45.0)
CAMERA_HEIGHT_M = 1.45

# Map
MAP_DENSITY_PER_M = 10.0  # k_minimum_map_density
MAP_TOLERANCE_M = 3.0  # k_map_tolerance

# Safety chain
HEARTBEAT_PERIOD_S = 0.1
HEARTBEAT_TIMEOUT_S = 0.25  # firmware: no heartbeat for this long, ramp to stop, driver off
DISARM_TIMEOUT_S = 1.0  # firmware: then a START is needed again
PERMIT_RATE_HZ = 10.0
PERMIT_TIMEOUT_S = 0.2  # bridge: an older permit is none
FREE_LEASE_S = 0.4  # links and tokens of a frozen process but comm's are given up then (`zenoh_session.lease_s`)
WATCHDOG_CLEAR_S = 1.0  # comm: all on-robot modules ready for this long before the watchdog's stop clears
STARTUP_GRACE_S = 90.0
REVERSE_MAX_M = 0.5  # firmware: backwards only over floor driven just now
