"""Starts the node for a running camera.

ros2 launch stillpoint_ros2 stillpoint.launch.py
ros2 launch stillpoint_ros2 stillpoint.launch.py color:=/front/color/image_raw depth:=/front/aligned_depth_to_color/image_raw namespace:=robot1
"""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

CAMERA = "/camera/camera"


def generate_launch_description():
    config = PathJoinSubstitution([FindPackageShare("stillpoint_ros2"), "config", "stillpoint.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument("color", default_value=CAMERA + "/color/image_raw", description="Topic of colour images"),
        DeclareLaunchArgument("depth", default_value=CAMERA + "/aligned_depth_to_color/image_raw", description="Topic of depth images"),
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the node"),
        DeclareLaunchArgument("params_file", default_value=config, description="File of parameters"),
        Node(
            package="stillpoint_ros2",
            executable="stillpoint-ros2",
            name="stillpoint",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file")],
            remappings=[
                ("camera/color/image_raw", LaunchConfiguration("color")),
                ("camera/aligned_depth_to_color/image_raw", LaunchConfiguration("depth")),
            ],
            output="screen",
        ),
    ])
