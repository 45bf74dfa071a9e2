//! What stands between every source of commands and the driver.
//!
//! [`SafetyFilter`] lets a set point of the arm pass when the arm could still come to rest from it within every limit and touching
//! nothing; [`HandFilter`] does the same for the hand's two motors.

mod audit;
mod brake;
mod filter;
mod hand;
mod limit;
mod way;

pub use audit::{Breach, audit};
pub use filter::{FilterSettings, PalmBox, SafetyFilter, Sent};
pub use hand::HandFilter;
pub use limit::{Intervention, Limit};
