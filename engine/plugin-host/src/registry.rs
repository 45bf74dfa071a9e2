//! Plugins by contract and name.

use crate::library::load_library;
use crate::{Contract, DynamicPoseGenerator, Found, HostError, LoadedPlugin};
use sfg_plugin::{Driver, GraspPolicy, Grounder, LlmBackend, PluginContext, PluginError, PoseGenerator};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Makes a plugin of contract `T`.
pub type Make<T> = Box<dyn Fn(&PluginContext<'_>) -> Result<Box<T>, PluginError> + Send + Sync>;

/// Every plugin that a scenario can name.
#[derive(Default)]
pub struct Registry {
    llm: BTreeMap<String, Make<dyn LlmBackend>>,
    grounder: BTreeMap<String, Make<dyn Grounder>>,
    pose_generator: BTreeMap<String, Make<dyn PoseGenerator>>,
    grasp_policy: BTreeMap<String, Make<dyn GraspPolicy>>,
    driver: BTreeMap<String, Make<dyn Driver>>,
}

/// What became of a library.
#[derive(Debug)]
pub struct LibraryReport {
    /// The file.
    pub path: PathBuf,
    /// The plugins it added, or why it was refused.
    pub outcome: Result<Vec<(Contract, String)>, HostError>,
}

/// The two methods of a contract: how one is registered and how one is made.
macro_rules! contracts {
    ($($field:ident $make:ident $contract:ident $role:ident;)*) => {
        impl Registry {
            $(
                #[doc = concat!("Registers a built-in [`", stringify!($role), "`] under `name`.")]
                ///
                /// # Panics
                /// If the name is taken: built-ins are named in one place of the application.
                pub fn $field<F>(&mut self, name: &str, make: F) -> &mut Self
                where
                    F: Fn(&PluginContext<'_>) -> Result<Box<dyn $role>, PluginError> + Send + Sync + 'static,
                {
                    let earlier = self.$field.insert(name.to_owned(), Box::new(make));
                    assert!(earlier.is_none(), "two built-in {} plugins are named {name:?}", stringify!($role));
                    self
                }

                #[doc = concat!("A new [`", stringify!($role), "`] of the kind registered under `name`.")]
                ///
                /// # Errors
                /// [`HostError::UnknownPlugin`] with the nearest names, [`HostError::Plugin`] when the plugin refuses its parameters.
                pub fn $make(&self, name: &str, context: &PluginContext<'_>) -> Result<Box<dyn $role>, HostError> {
                    let make = self.$field.get(name).ok_or_else(|| self.unknown(Contract::$contract, name))?;
                    Ok(make(context)?)
                }
            )*

            /// The names of `contract`, sorted: the words a scenario may use.
            #[must_use]
            pub fn names(&self, contract: Contract) -> Vec<String> {
                match contract {
                    $(Contract::$contract => self.$field.keys().cloned().collect(),)*
                }
            }
        }
    };
}

contracts! {
    llm make_llm Llm LlmBackend;
    grounder make_grounder Grounder Grounder;
    pose_generator make_pose_generator PoseGenerator PoseGenerator;
    grasp_policy make_grasp_policy GraspPolicy GraspPolicy;
    driver make_driver Driver Driver;
}

impl Registry {
    /// An empty registry.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Registers what `plugin` offers and returns the names.
    ///
    /// # Errors
    /// [`HostError::NoCapability`] when it offers nothing, [`HostError::Broken`] when a table cannot be used,
    /// [`HostError::DuplicateName`] when its name is taken: a library never replaces a plugin that is there.
    pub fn add_library(&mut self, plugin: &LoadedPlugin) -> Result<Vec<(Contract, String)>, HostError> {
        // The other contracts have no table yet, so only this one is asked for.
        let contract = Contract::PoseGenerator;
        let Some(factory) = plugin.pose_generator()? else {
            let asked = vec![contract.capability_id().to_owned()];
            return Err(HostError::NoCapability { path: plugin.path().to_owned(), asked });
        };
        let name = factory.name().to_owned();
        if self.pose_generator.contains_key(&name) {
            return Err(HostError::DuplicateName { path: plugin.path().to_owned(), contract, name });
        }
        self.pose_generator(&name, move |context| {
            DynamicPoseGenerator::new(&factory, context).map(|generator| Box::new(generator) as Box<dyn PoseGenerator>)
        });
        Ok(vec![(contract, name)])
    }

    /// Loads and registers every library of `found`, in order; one that is refused does not stop the others.
    pub fn add_found(&mut self, found: &Found) -> Vec<LibraryReport> {
        let mut add = |path: &PathBuf| {
            let outcome = load_library(path).and_then(|plugin| self.add_library(&plugin));
            LibraryReport { path: path.clone(), outcome }
        };
        found.libraries.iter().map(&mut add).collect()
    }

    fn unknown(&self, contract: Contract, name: &str) -> HostError {
        let known = self.names(contract);
        let mut similar: Vec<(f64, &String)> =
            known.iter().map(|other| (strsim::jaro_winkler(name, other), other)).filter(|(score, _)| *score > 0.7).collect();
        similar.sort_by(|a, b| b.0.total_cmp(&a.0));
        let nearest = similar.into_iter().take(3).map(|(_, name)| name.clone()).collect();
        HostError::UnknownPlugin { contract, name: name.to_owned(), nearest, known }
    }
}

impl std::fmt::Debug for Registry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_map().entries(Contract::ALL.map(|contract| (contract.key(), self.names(contract)))).finish()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;
    use sfg_plugin::{PoseRequest, testing};
    use sfg_types::{HandSide, PalmPoseCandidate};
    use std::path::Path;

    struct Nothing;

    impl PoseGenerator for Nothing {
        fn generate(&mut self, _: &PoseRequest<'_>, _: &mut [PalmPoseCandidate]) -> Result<usize, PluginError> {
            Ok(0)
        }
    }

    fn registry() -> Registry {
        let mut registry = Registry::new();
        registry
            .pose_generator("analytic", |_| Ok(Box::new(Nothing)))
            .pose_generator("known-model", |_| Ok(Box::new(Nothing)))
            .pose_generator("network", |context| {
                let message = format!("unknown parameter in {}", context.params);
                Err(PluginError::BadParameter { plugin: "network".to_owned(), message })
            });
        registry
    }

    #[track_caller]
    fn check(name: &str, expected: Option<&str>) {
        let hand = testing::hand_profile();
        let params = serde_json::json!({"speed": 1});
        let context =
            PluginContext { params: &params, scenarios_dir: Path::new("."), hand: &hand, hand_side: HandSide::Left, seed: 1 };
        let message = registry().make_pose_generator(name, &context).err().map(|error| error.to_string());
        assert_eq!(message.as_deref(), expected);
    }

    #[test]
    fn plugins_are_made_by_name_and_unknown_names_get_suggestions() {
        let known = "known: \"analytic\", \"known-model\", \"network\"";
        check("analytic", None);
        let analitic = format!("unknown pose_generator plugin \"analitic\"; did you mean \"analytic\"; {known}");
        check("analitic", Some(&analitic));
        check("zzz", Some(&format!("unknown pose_generator plugin \"zzz\"; {known}")));
        check("network", Some("plugin \"network\": unknown parameter in {\"speed\":1}"));
    }

    #[test]
    fn names_are_sorted_and_kept_apart_by_contract() {
        assert_eq!(registry().names(Contract::PoseGenerator), ["analytic", "known-model", "network"]);
        assert!(registry().names(Contract::Driver).is_empty());
    }

    #[test]
    #[should_panic(expected = "two built-in PoseGenerator plugins are named \"analytic\"")]
    fn a_built_in_name_is_taken_once() {
        registry().pose_generator("analytic", |_| Ok(Box::new(Nothing)));
    }
}
