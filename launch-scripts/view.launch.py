"""Rig and twin with a viewer: the deformed tissue, the frames and the rig itself in RViz, or all topics for Foxglove."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import Command, EqualsSubstitution, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackagePrefix, FindPackageShare


def generate_launch_description():
    share = FindPackageShare("needle_twin")
    namespace, viewer = LaunchConfiguration("namespace"), LaunchConfiguration("viewer")
    # Several systems run side by side, each in a namespace, with a clock and a tree of frames of its own.
    remappings = [("/clock", "clock"), ("/tf", "tf"), ("/tf_static", "tf_static")]
    own = {"namespace": namespace, "remappings": remappings, "output": "screen"}
    programs = PathJoinSubstitution([FindPackagePrefix("needle_twin"), "lib", "needle_twin", "needle_twin"])
    # With the sizes of the scene. The surface of a sample with a mesh goes into the file.
    description = Command([
        programs, " scene urdf '", LaunchConfiguration("scene"), "' --mesh '", LaunchConfiguration("mesh_file"), "'",
    ])
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes, their clock and their frames"),
        DeclareLaunchArgument("viewer", default_value="rviz", description="rviz, foxglove (starts foxglove_bridge) or none"),
        DeclareLaunchArgument("scene", default_value="needle_insertion", description="Scene of the twin: preset or file"),
        DeclareLaunchArgument(
            "mesh_file",
            default_value="/tmp/needle_twin_sample.stl",
            description="Where the surface of a sample with a mesh is written",
        ),
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
            parameters=[
                LaunchConfiguration("params_file"),
                {"scene": LaunchConfiguration("scene"), "use_sim_time": True},
            ],
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
        # It publishes robot_description alone. The frames come from the twin, which knows free poses as well.
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            namespace=namespace,
            output="screen",
            parameters=[{"robot_description": ParameterValue(description, value_type=str), "use_sim_time": True}],
            remappings=[
                ("/clock", "clock"),
                ("joint_states", "unused/joint_states"),
                ("/tf", "unused/tf"),
                ("/tf_static", "unused/tf_static"),
            ],
        ),
        Node(
            package="rviz2",
            executable="rviz2",
            namespace=namespace,
            remappings=remappings,
            arguments=["-d", PathJoinSubstitution([share, "layouts", "needle_twin.rviz"])],
            parameters=[{"use_sim_time": True}],
            condition=IfCondition(EqualsSubstitution(viewer, "rviz")),
        ),
        Node(
            package="foxglove_bridge",
            executable="foxglove_bridge",
            namespace=namespace,
            remappings=remappings,
            parameters=[{"use_sim_time": True}],
            condition=IfCondition(EqualsSubstitution(viewer, "foxglove")),
        ),
    ])
