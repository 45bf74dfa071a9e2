//! Parameters of the policy as they stand in a scenario.

use sfg_plugin::PluginError;

/// Name under which the plugin is registered.
pub const PLUGIN_NAME: &str = "synergy";

/// What can be set from a scenario: `grasp_policy: {synergy: {grip_current_fraction: 0.7}}`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SynergyPolicySettings {
    /// Grip at which closing stops, as a fraction of the way from the free hand's current to the stall current. A firmer grip turns what
    /// it holds: of 24 development pours 19 were right at 0.45, 18 at 0.6 and 12 at 0.8, while 63 of 72 first lifts of drawn bottles of
    /// 0.25 kg held at 0.45 and 104 of 120 at 0.7.
    pub grip_current_fraction: f64,
    /// Time from the preshape to `c_tar`, seconds: slow enough for a light object to be enclosed before it is pushed away.
    pub closing_secs: f64,
    /// Speed of `c1` beyond `c_tar`, strokes per second.
    pub pressing_speed_per_sec: f64,
    /// How long the grip current must last before it counts, seconds: a finger that flicks past an edge draws a peak.
    pub debounce_secs: f64,
    /// The hand is at rest when both motors stayed within 1 % of a stroke for this long, seconds.
    pub rest_secs: f64,
    /// Everything ends after this long, seconds.
    pub timeout_secs: f64,
}

impl Default for SynergyPolicySettings {
    fn default() -> Self {
        Self {
            grip_current_fraction: 0.45,
            closing_secs: 1.0,
            pressing_speed_per_sec: 0.6,
            debounce_secs: 0.04,
            rest_secs: 0.15,
            timeout_secs: 3.0,
        }
    }
}

impl SynergyPolicySettings {
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
            let (field, low, high) = match key.as_str() {
                "grip_current_fraction" => (&mut settings.grip_current_fraction, 0.05, 1.0),
                "closing_secs" => (&mut settings.closing_secs, 0.2, 2.0),
                "pressing_speed_per_sec" => (&mut settings.pressing_speed_per_sec, 0.05, 5.0),
                "debounce_secs" => (&mut settings.debounce_secs, 0.0, 0.5),
                "rest_secs" => (&mut settings.rest_secs, 0.0, 1.0),
                "timeout_secs" => (&mut settings.timeout_secs, 0.5, 10.0),
                _ => {
                    let known =
                        "grip_current_fraction, closing_secs, pressing_speed_per_sec, debounce_secs, rest_secs, timeout_secs";
                    return Err(bad(format!("unknown parameter {key:?}; known are {known}")));
                }
            };
            *field = value
                .as_f64()
                .filter(|x| (low..=high).contains(x))
                .ok_or_else(|| bad(format!("{key:?} must be a number from {low} to {high}, not {value}")))?;
        }
        Ok(settings)
    }
}
