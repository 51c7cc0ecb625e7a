"""The nodes that ship with robo: the reference robot's and the reusable ones.

Each module is a service: `robo run robo_services.position_tracker`, or `service:` in a manifest.
Pure logic stands beside the nodes and works without Zenoh: `limits`, `smoothing`, `mux`, `kinematics`, `drives`,
`wheel_odometry`, `uncertainty`, `planar`, `world`, `simulated_base`, `odometry_check`, `contact`, `obstacles`,
`collision`, `zones`, `safety`, `routes`, `pursuit`, `urdf_model`, `robot_state`, `teleop`, `joystick`,
`joy_driving`.
"""
