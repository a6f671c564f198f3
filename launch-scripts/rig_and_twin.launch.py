"""Rig and twin: a recording is played, the twin predicts, both in simulated time."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare("needle_twin")
    # Several systems run side by side, each in a namespace, with a clock and a tree of frames of its own.
    remappings = [("/clock", "clock"), ("/tf", "tf"), ("/tf_static", "tf_static")]
    own = {"namespace": LaunchConfiguration("namespace"), "remappings": remappings, "output": "screen"}
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes and of their clock"),
        DeclareLaunchArgument(
            "bag",
            default_value=PathJoinSubstitution([share, "bags", "needle_insertion"]),
            description="Recording to play: rosbag2 folder or .mcap",
        ),
        DeclareLaunchArgument("rate", default_value="1.0", description="Seconds of the recording per second"),
        DeclareLaunchArgument(
            "params_file",
            default_value=PathJoinSubstitution([share, "parameters", "twin.yaml"]),
            description="Parameter file of the twin",
        ),
        DeclareLaunchArgument("log_level", default_value="info", description="debug, info, warn, error or fatal"),
        DeclareLaunchArgument("respawn", default_value="false", description="Start the twin again if it dies"),
        Node(
            package="needle_twin",
            executable="twin_node",
            name="twin",
            **own,
            respawn=LaunchConfiguration("respawn"),
            respawn_delay=1.0,
            parameters=[LaunchConfiguration("params_file"), {"use_sim_time": True}],
            ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        ),
        Node(
            package="needle_twin",
            executable="rig_node",
            name="rig",
            **own,
            parameters=[
                PathJoinSubstitution([share, "parameters", "rig_player.yaml"]),
                # The model is built meanwhile.
                {"bag": LaunchConfiguration("bag"), "rate": LaunchConfiguration("rate"), "delay": 8.0},
            ],
            ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        ),
    ])
