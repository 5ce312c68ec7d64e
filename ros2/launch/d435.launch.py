"""Starts an Intel RealSense D435 and the node.

ros2 launch stillpoint_ros2 d435.launch.py
"""
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare


def include(package, *path, **arguments):
    source = PythonLaunchDescriptionSource(PathJoinSubstitution([FindPackageShare(package), *path]))
    return IncludeLaunchDescription(source, launch_arguments=arguments.items())


def generate_launch_description():
    return LaunchDescription([
        include("realsense2_camera", "launch", "rs_launch.py", **{
            "align_depth.enable": "true",
            "enable_sync": "true",
            "rgb_camera.color_profile": "640x480x30",
            "depth_module.depth_profile": "640x480x30",
        }),
        include("stillpoint_ros2", "launch", "stillpoint.launch.py"),
    ])
