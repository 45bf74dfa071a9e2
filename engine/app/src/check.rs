//! A scenario with everything that it names found and fitting.

use crate::assets::Assets;
use crate::{plugins, scene, sensed};
use anyhow::{Context as _, Result};
use sfg_driver_sim::world::{PREDICATES, Predicate};
use sfg_kinematics::RobotModel;
use sfg_plugin_host::Contract;
use sfg_scenario::{Mistake, ObjectShape, Scenario, SceneObject, Vocabulary};
use sfg_skills::SkillContext;
use sfg_synergy::SynergySpace;
use sfg_tree::Registry;
use sfg_types::FailureReason;
use std::path::Path;

/// Something the user gave is wrong: told apart from a broken environment by its exit code.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct BadInput(pub(crate) String);

/// A checked scenario, the nodes it was checked with and its robot.
pub(crate) struct Checked {
    pub(crate) scenario: Scenario,
    pub(crate) registry: Registry<SkillContext>,
    pub(crate) model: RobotModel,
}

impl Checked {
    /// Loads and checks the scenario in the file at `path`.
    pub(crate) fn load(assets: &Assets, path: &Path) -> Result<Self> {
        let registry = node_registry();
        let vocabulary = vocabulary(assets);
        let scenario = Scenario::load(path, &registry, &vocabulary)
            .map_err(|errors| BadInput(format!("{}\n{errors}", summary(errors.count()))))?;
        let robot = &assets.robots[&scenario.robot.value];
        let model = RobotModel::load(robot).map_err(|error| BadInput(error.to_string()))?;
        let profile = model.hand_profile.as_ref().context("the robot has no hand profile")?;
        SynergySpace::new(profile).map_err(|error| BadInput(format!("{}: {error}", robot.display())))?;
        let mut mistakes = object_mistakes(&scenario, assets);
        mistakes.extend(plugins::mistakes(&plugins::PluginSetting { assets, profile, scenario: &scenario, seed: 0 }));
        mistakes.extend(predicate_mistakes(&scenario));
        if !mistakes.is_empty() {
            let errors = scenario.errors(mistakes);
            return Err(BadInput(format!("{}\n{errors}", summary(errors.count()))).into());
        }
        Ok(Self { scenario, registry, model })
    }

    /// How many nodes the scenario's tree has.
    pub(crate) fn n_nodes(&self) -> Result<usize> {
        Ok(self.scenario.build_tree(&self.registry)?.definition().count())
    }
}

fn summary(n_mistakes: usize) -> String {
    if n_mistakes == 1 { "1 mistake".to_owned() } else { format!("{n_mistakes} mistakes") }
}

/// Every node a scenario can use.
fn node_registry() -> Registry<SkillContext> {
    let mut registry = Registry::new();
    sfg_skills::register(&mut registry);
    registry
}

/// Every name a scenario can use.
fn vocabulary(assets: &Assets) -> Vocabulary {
    Vocabulary {
        robots: assets.robots.keys().cloned().collect(),
        object_models: assets.models.keys().cloned().collect(),
        llm: plugins::names(Contract::Llm),
        grounder: plugins::names(Contract::Grounder),
        pose_generator: plugins::names(Contract::PoseGenerator),
        grasp_policy: plugins::names(Contract::GraspPolicy),
        driver: plugins::DRIVERS.iter().map(|name| (*name).to_owned()).collect(),
        truth_predicates: PREDICATES.iter().map(|predicate| predicate.name.to_owned()).collect(),
        sensed_predicates: sensed::PREDICATES.iter().map(|(name, _)| (*name).to_owned()).collect(),
        reasons: FailureReason::ALL.iter().map(|reason| reason.name().to_owned()).collect(),
    }
}

/// The committed schema's text.
pub(crate) fn schema_text(assets: &Assets) -> Result<String> {
    let schema = sfg_scenario::schema(node_registry().models(), &vocabulary(assets));
    Ok(serde_json::to_string_pretty(&schema)?)
}

/// Objects whose files are missing or broken, that cannot be made in the sizes asked for, or that cannot hold what is in them.
fn object_mistakes(scenario: &Scenario, assets: &Assets) -> Vec<Mistake> {
    let mistake = |object: &SceneObject| {
        let place = object.name.place;
        match scene::instance_of(object, scenario, assets, &mut |range| range.at(0.5)) {
            Err(error) => Some(Mistake::new(place, crate::say::chain(&error))),
            Ok(made) if object.filled_grains > 0 && made.interior.is_none() => {
                let mistake = Mistake::new(place, format!("object {:?} is to hold grains but is no vessel", object.name.value));
                Some(match object.shape {
                    ObjectShape::Model(_) => mistake,
                    ObjectShape::Scanned { .. } => mistake.help("bore a closed scan: `hollow: {mouth_m: 0.15, wall_m: 0.004}`"),
                })
            }
            Ok(_) => None,
        }
    };
    scenario.scene.objects.iter().filter_map(mistake).collect()
}

/// Arguments of predicates that do not fit, and objects they name that are not in the scene.
fn predicate_mistakes(scenario: &Scenario) -> Vec<Mistake> {
    let mut mistakes = Vec::new();
    let names: Vec<&str> = scenario.scene.objects.iter().map(|object| object.name.value.as_str()).collect();
    for predicate in &scenario.success.truth {
        let json = serde_json::json!({ predicate.name.clone(): predicate.args_json() });
        if let Err(error) = serde_json::from_value::<Predicate>(json) {
            mistakes.push(Mistake::new(predicate.place, format!("predicate {:?}: {error}", predicate.name)));
        }
        for key in ["object", "container"] {
            if let Some(arg) = predicate.arg(key)
                && let sfg_tree::Literal::Text(name) = &arg.value
                && !names.contains(&name.as_str())
            {
                let message = format!("{key} {name:?} is not in the scene");
                mistakes.push(Mistake::new(arg.place, message).help(format!("the scene has {}", names.join(", "))));
            }
        }
    }
    for predicate in &scenario.success.sensed {
        let known = sensed::PREDICATES.iter().find(|(name, _)| *name == predicate.name).map_or(&[][..], |(_, args)| *args);
        for (name, value) in &predicate.args {
            if !known.contains(&name.as_str()) {
                let message = format!("predicate {:?} has no argument {name:?}", predicate.name);
                mistakes.push(Mistake::new(value.place, message).help(format!("it takes {}", known.join(", "))));
            }
        }
        for name in known {
            if predicate.arg(name).is_none() {
                let message = format!("predicate {:?} needs argument {name:?}", predicate.name);
                mistakes.push(Mistake::new(predicate.place, message));
            }
        }
    }
    mistakes
}
