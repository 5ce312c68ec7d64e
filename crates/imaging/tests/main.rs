//! Images and pyramids.

mod pyramid;
