"""Needle driver, twin and guard: inserts the needle under supervision, and stops when something is lost or out of bounds."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare("needle_twin")
    namespace = LaunchConfiguration("namespace")
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes and of their clock"),
        DeclareLaunchArgument(
            "twin_params_file",
            default_value=PathJoinSubstitution([share, "parameters", "twin.yaml"]),
            description="Parameter file of the twin",
        ),
        DeclareLaunchArgument(
            "guard_params_file",
            default_value=PathJoinSubstitution([share, "parameters", "guard.yaml"]),
            description="Parameter file of the guarded insertion",
        ),
        DeclareLaunchArgument("respawn", default_value="false", description="Start the twin again if it dies"),
        Node(
            package="needle_twin",
            executable="twin_node",
            name="twin",
            namespace=namespace,
            output="screen",
            respawn=LaunchConfiguration("respawn"),
            respawn_delay=1.0,
            parameters=[LaunchConfiguration("twin_params_file")],
        ),
        # Your own driver takes the place of this node.
        Node(
            package="needle_twin",
            executable="rig_node",
            name="rig",
            namespace=namespace,
            output="screen",
            parameters=[PathJoinSubstitution([share, "parameters", "rig_driver.yaml"])],
        ),
        Node(
            package="needle_twin",
            executable="needle_twin",
            arguments=["guard"],
            name="guard",
            namespace=namespace,
            output="screen",
            parameters=[LaunchConfiguration("guard_params_file")],
        ),
    ])
