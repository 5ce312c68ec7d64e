//! The stages of the SLAM system and the inline driver that runs them.
