//! `stillpoint-ros2`: the node.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use stillpoint_ros2::arguments::{self, Arguments, NODE};
use stillpoint_ros2::bus::Reach;
use stillpoint_ros2::node::Node;
use stillpoint_ros2::options;
use stillpoint_ros2::type_hash;

fn main() -> ExitCode {
    let request = match arguments::read(std::env::args().skip(1)) {
        Ok(Arguments::Help) => {
            help();
            return ExitCode::SUCCESS;
        }
        Ok(Arguments::Version) => {
            println!("stillpoint-ros2 {}", env!("CARGO_PKG_VERSION"));
            return ExitCode::SUCCESS;
        }
        Ok(Arguments::Types) => {
            for (name, hash) in type_hash::all() {
                println!("{name} {hash}");
            }
            return ExitCode::SUCCESS;
        }
        Ok(Arguments::Run(request)) => request,
        Err(e) => return usage(&e),
    };
    let reach = Reach::of_environment(|name| std::env::var(name).ok());
    let reach = match reach {
        Ok(reach) => reach,
        Err(e) => return usage(&e),
    };
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // The first signal finishes the run; a second one exits immediately.
        let twice =
            signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop));
        let once = signal_hook::flag::register(signal, Arc::clone(&stop));
        if let Err(e) = twice.and(once) {
            return usage(&format!("signals cannot be waited for: {e}"));
        }
    }
    let mut node = match Node::start(&request, reach) {
        Ok(node) => node,
        Err(e) => return usage(&e),
    };
    match node.run_until(&stop) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{NODE}: {e}");
            ExitCode::FAILURE
        }
    }
}

fn usage(told: &str) -> ExitCode {
    eprintln!("{NODE}: {told}");
    ExitCode::from(2)
}

fn help() {
    println!(
        "Visual SLAM for RGB-D cameras, as a node of ROS 2.\n\n\
         stillpoint-ros2 [--ros-args [-r from:=to]... [-p name:=value]... [--params-file FILE]...]\n\n\
         --types lists the types of messages and services with their hashes.\n\n\
         Topics: camera/color/image_raw, camera/aligned_depth_to_color/image_raw, camera_info beside them, /tf_static, wheel_odometry.\n\
         Parameters of the node (those of the system are in `stillpoint config print`):\n"
    );
    for p in options::ALL {
        println!("  {} (default: {})\n      {}", p.name, p.default, p.text);
    }
}
