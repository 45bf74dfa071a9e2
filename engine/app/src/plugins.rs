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
            let complaint =
                |params: &serde_json::Value| make(&choice.name, &setting.context(params)).err().map(|error| error.to_string());
            let culprit = culprit(choice.param_places.keys().map(String::as_str), &choice.params, &complaint);
            let message = error.to_string();
            let place = match culprit.and_then(|name| choice.param_places.get(name)) {
                Some((name, _)) if is_about_name(&message) => *name,
                Some((_, value)) => *value,
                None => choice.place,
            };
            mistakes.push(Mistake::new(place, message));
        }
    };
    check(&chosen.llm, &|name, context| registry.make_llm(name, context).map(drop));
    check(&chosen.grounder, &|name, context| registry.make_grounder(name, context).map(drop));
    check(&chosen.pose_generator, &|name, context| registry.make_pose_generator(name, context).map(drop));
    check(&chosen.grasp_policy, &|name, context| registry.make_grasp_policy(name, context).map(drop));
    mistakes
}

/// The name of a parameter whose absence changes what is said against all of them: that one is at fault.
///
/// Plugins check their parameters themselves and say what is wrong in words, not where.
fn culprit<'a>(
    names: impl IntoIterator<Item = &'a str>,
    args: &serde_json::Value,
    complaint: &dyn Fn(&serde_json::Value) -> Option<String>,
) -> Option<&'a str> {
    let all = complaint(args)?;
    names.into_iter().find(|name| {
        let mut others = args.clone();
        others.as_object_mut().is_some_and(|others| others.shift_remove(*name).is_some())
            && complaint(&others).as_ref() != Some(&all)
    })
}

/// Whether the complaint is about a name, not about its value.
fn is_about_name(complaint: &str) -> bool {
    complaint.contains("unknown")
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
