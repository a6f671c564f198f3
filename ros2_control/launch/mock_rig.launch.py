"""A mock needle driver at 500 Hz, whose joint states the twin answers; its force comes back as a sensor of ros2_control.

To insert by 5 mm in 5 s:
  ros2 action send_goal /insertion_controller/follow_joint_trajectory control_msgs/action/FollowJointTrajectory \\
    "{trajectory: {joint_names: [insertion], points: [{positions: [0.005], time_from_start: {sec: 5}}]}}"
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import Command, FindExecutable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare("needle_twin_control")
    xacro = [FindExecutable(name="xacro"), " ", PathJoinSubstitution([share, "urdf", "mock_rig.urdf.xacro"])]
    controllers = PathJoinSubstitution([share, "config", "controllers.yaml"])
    spawned = ["joint_state_broadcaster", "predicted_force_broadcaster", "insertion_controller"]
    return LaunchDescription([
        DeclareLaunchArgument(
            "scene", default_value="needle_insertion", description="Scene of the twin; mock_rig.urdf.xacro has the height of this one"
        ),
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            output="screen",
            parameters=[{"robot_description": ParameterValue(Command(xacro), value_type=str)}],
        ),
        Node(package="controller_manager", executable="ros2_control_node", output="screen", parameters=[controllers]),
        Node(package="controller_manager", executable="spawner", output="screen", arguments=spawned),
        # The frames come from robot_state_publisher.
        Node(
            package="needle_twin",
            executable="twin_node",
            name="twin",
            output="screen",
            remappings=[("measured_js", "joint_states")],
            parameters=[{"scene": LaunchConfiguration("scene"), "joint_name": "insertion", "publish_tf": False}],
        ),
    ])
