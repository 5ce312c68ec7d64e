//! Stillpoint as a node of ROS 2, without an installation of ROS.
//!
//! Answers: what is typed becomes parameters, images of topics become frames, events of the run become messages. What is computed is the business of the library.

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
