//! A scenario with everything that it names found and fitting.

use crate::assets::Assets;
use crate::{plugins, reach, scene, sensed};
use anyhow::{Context as _, Result};
use sfg_driver_sim::world::{ArgKind, PREDICATES};
use sfg_kinematics::RobotModel;
use sfg_kinematics::reach::ReachMap;
use sfg_plugin_host::Contract;
use sfg_scenario::{
    Mistake, ObjectShape, Scenario, ScenarioErrors, ScenarioTests, SceneObject, Settings, Severity, Vocabulary, XmlTree,
};
use sfg_skills::SkillContext;
use sfg_synergy::SynergySpace;
use sfg_tree::{Literal, Registry, nearest};
use sfg_types::{FailureReason, HandProfile};
use std::path::Path;
use std::sync::Arc;

/// Something the user gave is wrong: told apart from a broken environment by its exit code.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct BadInput(pub(crate) String);

/// A checked scenario, the nodes it was checked with and its robot.
pub(crate) struct Checked {
    pub(crate) scenario: Scenario,
    pub(crate) registry: Registry<SkillContext>,
    pub(crate) model: RobotModel,
    /// Map of the acting arm, if one lies beside the robot.
    pub(crate) reach: Option<Arc<ReachMap>>,
}

impl Checked {
    /// Loads and checks the scenario in the file at `path`, with parameters set as in `name=value`.
    pub(crate) fn load(assets: &Assets, path: &Path, set: &[String]) -> Result<Self> {
        let registry = node_registry();
        let vocabulary = vocabulary(assets);
        let environment =
            std::env::vars_os().filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)));
        let settings = Settings::new(set, environment).map_err(|error| BadInput(error.to_string()))?;
        let scenario = Scenario::load(path, &settings, &registry, &vocabulary).map_err(|errors| refused(&errors))?;
        let robot = &assets.robots[&scenario.robot.value];
        let model = RobotModel::load(robot).map_err(|error| BadInput(error.to_string()))?;
        let profile = model.hand_profile.as_ref().context("the robot has no hand profile")?;
        SynergySpace::new(profile).map_err(|error| BadInput(format!("{}: {error}", robot.display())))?;
        let mistakes = mistakes(&scenario, assets, profile);
        if !mistakes.is_empty() {
            return Err(refused(&scenario.errors(mistakes)).into());
        }
        let reach = reach::for_run(robot, &model, scenario.arm)?.map(Arc::new);
        Ok(Self { scenario, registry, model, reach })
    }

    /// Loads a scenario, or a tree in XML with the scenario `scene` around it.
    pub(crate) fn load_in(assets: &Assets, path: &Path, scene: Option<&Path>, set: &[String]) -> Result<Self> {
        let is_xml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml"));
        let scene = match (is_xml, scene) {
            (false, None) => return Self::load(assets, path, set),
            (true, Some(scene)) => scene,
            (true, None) => {
                let message = format!("{} is only a tree; give the scenario to run it in with --scene FILE", path.display());
                return Err(BadInput(message).into());
            }
            (false, Some(_)) => {
                let message = format!("--scene goes with a tree in XML, and {} is none", path.display());
                return Err(BadInput(message).into());
            }
        };
        let tree = XmlTree::load(path).map_err(|errors| refused(&errors));
        let checked = match (tree, Self::load(assets, scene, set)) {
            (Ok(tree), Ok(checked)) => (tree, checked),
            // Mistakes of both, all at once.
            (Err(tree), Err(scene)) if scene.is::<BadInput>() => return Err(BadInput(format!("{tree}\n{scene}")).into()),
            (Err(error), _) => return Err(error.into()),
            (_, Err(error)) => return Err(error),
        };
        let (tree, Self { scenario, registry, model, reach }) = checked;
        let scenario = scenario.with_tree(tree, &registry).map_err(|errors| refused(&errors))?;
        Ok(Self { scenario, registry, model, reach })
    }

    /// How many nodes the scenario's tree has.
    pub(crate) fn n_nodes(&self) -> Result<usize> {
        Ok(self.scenario.build_tree(&self.registry)?.definition().count())
    }
}

/// The cases of the test file at `path`.
pub(crate) fn load_tests(assets: &Assets, path: &Path) -> Result<ScenarioTests, BadInput> {
    ScenarioTests::load(path, &node_registry(), &vocabulary(assets)).map_err(|errors| refused(&errors))
}

pub(crate) fn refused(errors: &ScenarioErrors) -> BadInput {
    let (n_errors, n_warnings) = (errors.count(Severity::Error), errors.count(Severity::Warning));
    let mut summary = numbered(n_errors, "mistake");
    if n_warnings > 0 {
        summary = format!("{summary}, {}", numbered(n_warnings, "warning"));
    }
    BadInput(format!("{summary}\n{errors}"))
}

pub(crate) fn numbered(n: usize, word: &str) -> String {
    if n == 1 { format!("1 {word}") } else { format!("{n} {word}s") }
}

/// What the application finds wrong with a scenario that is otherwise sound: everything that only plugins, object models and
/// the judge know.
fn mistakes(scenario: &Scenario, assets: &Assets, profile: &HandProfile) -> Vec<Mistake> {
    let mut mistakes = object_mistakes(scenario, assets);
    mistakes.extend(plugins::mistakes(&plugins::PluginSetting { assets, profile, scenario, seed: 0 }));
    mistakes.extend(predicate_mistakes(scenario));
    mistakes
}

/// Every node a scenario can use.
pub(crate) fn node_registry() -> Registry<SkillContext> {
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

/// The committed schema of test files.
pub(crate) fn test_schema_text(assets: &Assets) -> Result<String> {
    Ok(serde_json::to_string_pretty(&sfg_scenario::test_schema(&vocabulary(assets)))?)
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
    let objects: Vec<&str> = scenario.scene.objects.iter().map(|object| object.name.value.as_str()).collect();
    let mut mistakes = Vec::new();
    for predicate in &scenario.success.truth {
        let known = PREDICATES.iter().find(|spec| spec.name == predicate.name).map_or(&[][..], |spec| spec.args);
        let args: Vec<_> = known.iter().map(|arg| (arg.name, Some(arg.kind), arg.required)).collect();
        check_args(predicate, &args, &objects, &mut mistakes);
    }
    for predicate in &scenario.success.sensed {
        let known = sensed::PREDICATES.iter().find(|(name, _)| *name == predicate.name).map_or(&[][..], |(_, args)| *args);
        let args: Vec<_> = known.iter().map(|name| (*name, None, true)).collect();
        check_args(predicate, &args, &objects, &mut mistakes);
    }
    mistakes
}

/// `known` are names, what they take (nothing: any number) and whether they must be given.
fn check_args(
    predicate: &sfg_scenario::Predicate,
    known: &[(&str, Option<ArgKind>, bool)],
    objects: &[&str],
    mistakes: &mut Vec<Mistake>,
) {
    let what = format!("predicate {:?}", predicate.name);
    for (name, value) in &predicate.args {
        let Some((_, kind, _)) = known.iter().find(|(known, _, _)| *known == name.value) else {
            let help = match nearest(&name.value, known.iter().map(|(known, _, _)| *known)) {
                Some(near) => format!("did you mean {near:?}?"),
                None if known.is_empty() => "it takes none".to_owned(),
                None => format!("it takes {}", known.iter().map(|(known, _, _)| *known).collect::<Vec<_>>().join(", ")),
            };
            mistakes.push(Mistake::new(name.place, format!("{what} has no argument {:?}", name.value)).help(help));
            continue;
        };
        let number = match value.value {
            Literal::Int(number) => Some(number as f64),
            Literal::Float(number) => Some(number),
            _ => None,
        };
        let (fits, expected) = match (kind, number, &value.value) {
            (Some(ArgKind::ObjectName), _, Literal::Text(object)) => {
                if !objects.contains(&object.as_str()) {
                    let help = match nearest(object, objects.iter().copied()) {
                        Some(near) => format!("did you mean {near:?}? the scene has {}", objects.join(", ")),
                        None => format!("the scene has {}", objects.join(", ")),
                    };
                    let message = format!("{} {object:?} is not in the scene", name.value);
                    mistakes.push(Mistake::new(value.place, message).help(help));
                }
                continue;
            }
            (Some(ArgKind::ObjectName), _, _) => (false, "the name of an object"),
            (Some(ArgKind::Share), number, _) => {
                (number.is_some_and(|share| (0.0..=1.0).contains(&share)), "a number from 0 to 1")
            }
            (Some(_), number, _) => (number.is_some_and(|number| number >= 0.0), "a number that is not negative"),
            (None, number, _) => (number.is_some(), "a number"),
        };
        if !fits {
            let message = format!("{what}: {} must be {expected}, found {}", name.value, value.value);
            mistakes.push(Mistake::new(value.place, message));
        }
    }
    for (name, _, required) in known {
        if *required && predicate.arg(name).is_none() {
            mistakes.push(Mistake::new(predicate.place, format!("{what} needs argument {name:?}")));
        }
    }
}

#[cfg(test)]
#[path = "mutants.rs"]
mod mutants;
