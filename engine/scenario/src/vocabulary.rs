//! The names a scenario may use.

/// Names known to the application. An empty list accepts every name, for applications that check it themselves.
#[derive(Clone, Debug, Default)]
pub struct Vocabulary {
    /// Robots that `robot` can name.
    pub robots: Vec<String>,
    /// Object models that `model` and `distractors.from` can name.
    pub object_models: Vec<String>,
    /// Plugins of the contract `llm`.
    pub llm: Vec<String>,
    /// Plugins of the contract `grounder`.
    pub grounder: Vec<String>,
    /// Plugins of the contract `pose_generator`.
    pub pose_generator: Vec<String>,
    /// Plugins of the contract `grasp_policy`.
    pub grasp_policy: Vec<String>,
    /// Plugins of the contract `driver`.
    pub driver: Vec<String>,
    /// Predicates that `success.truth` can name.
    pub truth_predicates: Vec<String>,
    /// Predicates that `success.sensed` can name.
    pub sensed_predicates: Vec<String>,
    /// Failure reasons that `retry.on` can name, besides the tree's own.
    pub reasons: Vec<String>,
}

impl Vocabulary {
    /// The plugins of a contract by the contract's key.
    pub(crate) fn plugins(&self, contract: &str) -> &[String] {
        match contract {
            "llm" => &self.llm,
            "grounder" => &self.grounder,
            "pose_generator" => &self.pose_generator,
            "grasp_policy" => &self.grasp_policy,
            _ => &self.driver,
        }
    }
}
