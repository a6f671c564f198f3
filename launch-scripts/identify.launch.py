"""Rig and twin: a recording is played, and the twin identifies what its parameter `identify` names meanwhile."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare("needle_twin")
    names = ("namespace", "bag", "rate", "params_file", "respawn")
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
            default_value=PathJoinSubstitution([share, "parameters", "identify.yaml"]),
            description="Parameter file of the twin",
        ),
        DeclareLaunchArgument("respawn", default_value="false", description="Start the twin again if it dies"),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(PathJoinSubstitution([share, "launch", "rig_and_twin.launch.py"])),
            launch_arguments=[(name, LaunchConfiguration(name)) for name in names],
        ),
    ])
