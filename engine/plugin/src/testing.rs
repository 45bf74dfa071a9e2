//! Suites of laws, one for each contract, that every implementation must keep, built-in or loaded.
//!
//! A suite feeds an implementation with small synthetic scenes and ordinary and broken input, and returns every broken law as a
//! sentence. It judges the contract, not the quality of the answers. Call it from a test of the implementation:
//!
//! ```no_run
//! # fn generator() -> Box<dyn sfg_plugin::PoseGenerator> { unimplemented!() }
//! let hand = sfg_plugin::testing::hand_profile();
//! assert_eq!(sfg_plugin::testing::pose_generator_suite(generator().as_mut(), &hand), Ok(()));
//! ```

mod driver;
mod grasp_policy;
mod grounder;
mod llm_backend;
mod pose_generator;
mod scenes;
#[cfg(test)]
mod tests;
mod views_of_a_table;

pub use driver::driver_suite;
pub use grasp_policy::grasp_policy_suite;
pub use grounder::grounder_suite;
pub use llm_backend::llm_backend_suite;
pub use pose_generator::pose_generator_suite;
pub use scenes::{PoseScene, hand_profile};
pub use views_of_a_table::{Block, table_observation};

use crate::PluginError;

/// Collects the laws that are broken.
#[derive(Debug, Default)]
struct Laws {
    broken: Vec<String>,
}

impl Laws {
    fn check(&mut self, kept: bool, law: impl FnOnce() -> String) {
        if !kept {
            self.broken.push(law());
        }
    }

    /// The value of an ordinary call; an error is a broken law.
    fn ok<T>(&mut self, case: &str, result: Result<T, PluginError>) -> Option<T> {
        result.map_err(|error| self.broken.push(format!("{case}: {error}"))).ok()
    }

    fn into_result(self) -> Result<(), Vec<String>> {
        if self.broken.is_empty() { Ok(()) } else { Err(self.broken) }
    }
}
