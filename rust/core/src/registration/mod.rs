//! Which point of the target's boundary belongs to which of the source's.

pub mod inner_distance;
pub mod matching;
pub mod sliding;
pub mod thin_plate;
