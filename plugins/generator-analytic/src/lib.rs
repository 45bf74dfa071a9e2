//! Palm poses from the TSDF surface, ranked by quasi-static closing, push, lean and wrench margin. No learning, no object model.
//!
//! | step | module |
//! |---|---|
//! | surface samples of the TSDF | [`surface`] |
//! | a solid of revolution or box fitted to the part and to the rest | [`shape`] |
//! | one distance field; the unseen side is the fit, never free space | [`field`] |
//! | palm poses for the grasp type | [`sampling`] |
//! | every finger closed along the synergy until it touches | [`closing`], on the compiled [`hand`] |
//! | force that the contacts resist | [`wrench`] |
//! | score, mean over the sides of a thing that look alike, diversity | [`ranking`] |
//!
//! Assumptions, stated because no camera shows them: the hidden side continues the fitted shape; friction and mass are the
//! settings' values; the object stays where it is while the hand closes; the palm comes to bear once the fingers pull.
//!
//! What wraps are ranked by was chosen on some 5,000 simulated closings of the hand alone, and on lifts, of drawn bottles of six shapes.

pub mod closing;
pub mod field;
mod generator;
pub mod hand;
pub mod ranking;
pub mod sampling;
pub mod settings;
pub mod shape;
pub mod surface;
pub mod wrench;

pub use generator::AnalyticGenerator;
pub use settings::AnalyticSettings;
