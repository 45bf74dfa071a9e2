//! Parameters of the generator as they stand in a scenario.

use sfg_plugin::PluginError;

/// Name under which the plugin is registered.
pub const PLUGIN_NAME: &str = "analytic";

/// What can be set from a scenario: `pose_generator: {analytic: {n_candidates: 15}}`.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyticSettings {
    /// Most candidates returned; the caller's buffer may be shorter. 15 as in the paper's experiments.
    pub n_candidates: usize,
    /// Friction coefficient assumed in the wrench margin: dry plastic on rubber pads, on the safe side.
    pub friction: f64,
    /// Mass assumed in the wrench margin, kilograms: a filled half-litre bottle.
    pub mass_kg: f64,
    /// Gap left between palm and object beyond the type's stand-off, metres: half a voxel, the accuracy of the surface.
    pub clearance_m: f64,
    /// Radius that the arm's last link needs behind the hand, metres (Panda link 7); it must clear the table too.
    pub wrist_radius_m: f64,
    /// For how many of the best candidates the margin is computed exactly, apart from those beside an upright thing, which share that of
    /// three. The others keep its upper bound, two to three times too high: keep this at `n_candidates` unless time matters more than order.
    pub n_exact: usize,
}

impl Default for AnalyticSettings {
    fn default() -> Self {
        Self { n_candidates: 15, friction: 0.5, mass_kg: 0.5, clearance_m: 0.004, wrist_radius_m: 0.055, n_exact: 40 }
    }
}

impl AnalyticSettings {
    /// Settings from the plugin's parameters.
    ///
    /// # Errors
    /// [`PluginError::BadParameter`] for an unknown key, a wrong type or a value out of range.
    pub fn from_params(params: &serde_json::Value) -> Result<Self, PluginError> {
        let bad = |message: String| PluginError::BadParameter { plugin: PLUGIN_NAME.to_owned(), message };
        let mut settings = Self::default();
        let object = match params {
            serde_json::Value::Null => return Ok(settings),
            serde_json::Value::Object(object) => object,
            other => return Err(bad(format!("parameters must be a mapping, not {other}"))),
        };
        for (key, value) in object {
            let number = |low: f64, high: f64| {
                value
                    .as_f64()
                    .filter(|x| (low..=high).contains(x))
                    .ok_or_else(|| bad(format!("{key:?} must be a number from {low} to {high}, not {value}")))
            };
            let count = |low: u64, high: u64| {
                value
                    .as_u64()
                    .filter(|x| (low..=high).contains(x))
                    .map(|x| x as usize)
                    .ok_or_else(|| bad(format!("{key:?} must be a whole number from {low} to {high}, not {value}")))
            };
            match key.as_str() {
                "n_candidates" => settings.n_candidates = count(1, 1000)?,
                "n_exact" => settings.n_exact = count(0, 1000)?,
                "friction" => settings.friction = number(0.05, 2.0)?,
                "mass_kg" => settings.mass_kg = number(0.01, 10.0)?,
                "clearance_m" => settings.clearance_m = number(0.0, 0.05)?,
                "wrist_radius_m" => settings.wrist_radius_m = number(0.0, 0.2)?,
                _ => {
                    let known = "n_candidates, n_exact, friction, mass_kg, clearance_m, wrist_radius_m";
                    return Err(bad(format!("unknown parameter {key:?}; known are {known}")));
                }
            }
        }
        Ok(settings)
    }
}
