//! Stillpoint as a node of ROS 2, without an installation of ROS.
//!
//! Converts arguments to parameters, images of topics to frames, and events of the run to messages. The algorithms are in the library.

mod about;
pub mod arguments;
pub mod bus;
pub mod camera;
pub mod fusing;
pub mod inertial;
pub mod intake;
pub mod losses;
pub mod maps;
pub mod mounting;
pub mod names;
pub mod node;
pub mod odometry;
pub mod options;
pub mod outlet;
pub mod outputs;
pub mod pairing;
pub mod parameters;
pub mod pictures;
pub mod priority;
pub mod record;
pub mod run;
pub mod say;
pub mod services;
pub mod timing;
pub mod type_hash;
pub mod value;
pub mod waiting;
