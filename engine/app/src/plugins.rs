//! The built-in plugins by name: the one place that knows concrete ones.

use crate::assets::Assets;
use anyhow::Result;
use sfg_plugin::{GraspPolicy, Grounder, LlmBackend, PluginContext, PoseGenerator};
use sfg_plugin_host::{Contract, HostError, Registry};
use sfg_scenario::{Mistake, PluginChoice, Scenario};
use sfg_skills::Plugins;
use sfg_types::HandProfile;

/// Names of the drivers; the simulator is made together with its judge, so it is not in the registry.
pub(crate) const DRIVERS: [&str; 1] = ["sim"];

/// The registry of everything that is built in.
pub(crate) fn registry() -> Registry {
    let mut registry = Registry::new();
    registry
        .llm("knowledge", |ctx| Ok(Box::new(sfg_llm_knowledge::KnowledgeBackend::new(ctx)?) as Box<dyn LlmBackend>))
        .grounder("geometric", |ctx| Ok(Box::new(sfg_grounder_geometric::GeometricGrounder::new(ctx)?) as Box<dyn Grounder>))
        .pose_generator("analytic", |ctx| {
            Ok(Box::new(sfg_generator_analytic::AnalyticGenerator::new(ctx)?) as Box<dyn PoseGenerator>)
        })
        .grasp_policy("synergy", |ctx| Ok(Box::new(sfg_policy_synergy::SynergyPolicy::new(ctx)?) as Box<dyn GraspPolicy>));
    registry
}

/// What the plugins of a run are made with.
pub(crate) struct PluginSetting<'a> {
    pub(crate) assets: &'a Assets,
    pub(crate) profile: &'a HandProfile,
    pub(crate) scenario: &'a Scenario,
    pub(crate) seed: u64,
}

impl PluginSetting<'_> {
    fn context<'a>(&'a self, params: &'a serde_json::Value) -> PluginContext<'a> {
        PluginContext {
            params,
            scenarios_dir: &self.assets.folder,
            hand: self.profile,
            hand_side: self.scenario.arm,
            seed: self.seed,
        }
    }
}

/// What the named plugins say against their parameters.
pub(crate) fn mistakes(setting: &PluginSetting<'_>) -> Vec<Mistake> {
    let registry = registry();
    let chosen = &setting.scenario.plugins;
    let mut mistakes = Vec::new();
    let mut check = |choice: &Option<PluginChoice>, make: &dyn Fn(&str, &PluginContext<'_>) -> Result<(), HostError>| {
        if let Some(choice) = choice
            && let Err(error) = make(&choice.name, &setting.context(&choice.params))
        {
            mistakes.push(Mistake::new(choice.place, error.to_string()));
        }
    };
    check(&chosen.llm, &|name, context| registry.make_llm(name, context).map(drop));
    check(&chosen.grounder, &|name, context| registry.make_grounder(name, context).map(drop));
    check(&chosen.pose_generator, &|name, context| registry.make_pose_generator(name, context).map(drop));
    check(&chosen.grasp_policy, &|name, context| registry.make_grasp_policy(name, context).map(drop));
    mistakes
}

/// The plugins that a scenario names, the defaults where it names none.
pub(crate) fn make(setting: &PluginSetting<'_>) -> Result<Plugins> {
    let registry = registry();
    let none = serde_json::json!({});
    let context = |params| setting.context(params);
    let chosen = &setting.scenario.plugins;
    let pick = |choice: &'_ Option<PluginChoice>, default: &str| -> (String, serde_json::Value) {
        choice.as_ref().map_or_else(|| (default.to_owned(), none.clone()), |choice| (choice.name.clone(), choice.params.clone()))
    };
    let (llm, llm_params) = pick(&chosen.llm, "knowledge");
    let (grounder, grounder_params) = pick(&chosen.grounder, "geometric");
    let (generator, generator_params) = pick(&chosen.pose_generator, "analytic");
    let (policy, policy_params) = pick(&chosen.grasp_policy, "synergy");
    Ok(Plugins {
        llm: registry.make_llm(&llm, &context(&llm_params))?,
        grounder: registry.make_grounder(&grounder, &context(&grounder_params))?,
        pose_generator: registry.make_pose_generator(&generator, &context(&generator_params))?,
        grasp_policy: registry.make_grasp_policy(&policy, &context(&policy_params))?,
    })
}

/// Names of a contract's plugins.
pub(crate) fn names(contract: Contract) -> Vec<String> {
    registry().names(contract)
}
