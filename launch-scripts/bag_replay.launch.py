"""The twin behind `ros2 bag play`: any bag that has measured_js (or measured_cp)."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare("needle_twin")
    return LaunchDescription([
        DeclareLaunchArgument(
            "bag",
            default_value=PathJoinSubstitution([share, "bags", "needle_insertion"]),
            description="Recording to play: rosbag2 folder or .mcap",
        ),
        DeclareLaunchArgument("rate", default_value="1.0", description="Seconds of the recording per second"),
        DeclareLaunchArgument("respawn", default_value="false", description="Start the twin again if it dies"),
        Node(
            package="needle_twin",
            executable="twin_node",
            name="twin",
            output="screen",
            respawn=LaunchConfiguration("respawn"),
            respawn_delay=1.0,
            parameters=[PathJoinSubstitution([share, "parameters", "twin.yaml"]), {"use_sim_time": True}],
        ),
        ExecuteProcess(
            cmd=[
                "ros2", "bag", "play", LaunchConfiguration("bag"), "--rate", LaunchConfiguration("rate"),
                "--clock", "100", "--delay", "8",
            ],
            output="screen",
        ),
    ])
