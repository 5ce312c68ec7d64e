//! Visual SLAM that stays still while the world moves: the library facade.
