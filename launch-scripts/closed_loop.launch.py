"""Needle driver and twin: whoever publishes servo_jp moves the needle, the twin says what the tissue answers."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare("needle_twin")
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes and of their clock"),
        DeclareLaunchArgument(
            "params_file",
            default_value=PathJoinSubstitution([share, "parameters", "twin.yaml"]),
            description="Parameter file of the twin",
        ),
        DeclareLaunchArgument("respawn", default_value="false", description="Start the twin again if it dies"),
        Node(
            package="needle_twin",
            executable="twin_node",
            name="twin",
            namespace=LaunchConfiguration("namespace"),
            output="screen",
            respawn=LaunchConfiguration("respawn"),
            respawn_delay=1.0,
            parameters=[LaunchConfiguration("params_file")],
        ),
        Node(
            package="needle_twin",
            executable="rig_node",
            name="rig",
            namespace=LaunchConfiguration("namespace"),
            output="screen",
            parameters=[PathJoinSubstitution([share, "parameters", "rig_driver.yaml"])],
        ),
    ])
