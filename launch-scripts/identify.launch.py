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
        DeclareLaunchArgument("namespace", default_value=""),
        DeclareLaunchArgument("bag", default_value=PathJoinSubstitution([share, "bags", "needle_insertion"])),
        DeclareLaunchArgument("rate", default_value="1.0"),
        DeclareLaunchArgument(
            "params_file", default_value=PathJoinSubstitution([share, "parameters", "identify.yaml"])
        ),
        DeclareLaunchArgument("respawn", default_value="false"),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(PathJoinSubstitution([share, "launch", "rig_and_twin.launch.py"])),
            launch_arguments=[(name, LaunchConfiguration(name)) for name in names],
        ),
    ])
