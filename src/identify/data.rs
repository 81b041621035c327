//! Runs from logs, and what is known of them before they are fitted.

mod autopilot;
mod load;
mod memory;
mod still;
mod stretched;
mod vehicle;

pub use load::{LoadError, capacity, load, load_messages, unwrap_turns};
pub use memory::memory_s;
pub use still::{NOISE_KEY, STILL_MIN_S, StillWatch, before_the_first_load, is_still, still_noise};
pub use stretched::{TooSparse, stretched};
pub use vehicle::{check_vehicle, differences};
