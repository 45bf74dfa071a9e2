//! Laws of a language backend.

use super::{Laws, scenes::TABLE_HEIGHT_M};
use crate::{FunctionalityRequest, LlmBackend};
use sfg_types::{
    ColourName, FunctionalityAnswer, GraspFunctionality, Instruction, ObjectCluster, Point, RankedName, SceneInventory,
    ShapeClass, Task, Vector,
};

/// Every law that `backend` breaks: it names things of the inventory by their numbers, pours from one thing into another, refuses
/// an absent object and an empty table, asks with at least two choices, gives reasons, answers the same question the same way,
/// and survives nonsense.
///
/// # Errors
/// The broken laws, a sentence each.
pub fn llm_backend_suite(backend: &mut dyn LlmBackend) -> Result<(), Vec<String>> {
    let mut laws = Laws::default();
    let table = bottle_and_bowl();
    let empty = SceneInventory { clusters: Vec::new(), table_height_m: TABLE_HEIGHT_M };

    let pour = "Pour the water from the bottle into the bowl.";
    match ask(backend, pour, &table, &mut laws) {
        Some(FunctionalityAnswer::Act(plan)) => {
            laws.check(plan.task == Task::Pour, || format!("{pour:?}: the task is {}", plan.task));
            laws.check(plan.object.cluster_id == BOTTLE, || format!("{pour:?}: thing {} is held", plan.object.cluster_id));
            let target = plan.target.as_ref().map(|target| target.cluster_id);
            laws.check(target == Some(BOWL), || format!("{pour:?}: the target is thing {target:?}, not the bowl"));
        }
        Some(other) => laws.check(false, || format!("{pour:?}: an unambiguous sentence got {other:?}")),
        None => {}
    }
    let absent = "Hand me the scissors, please.";
    for (case, inventory) in [(absent, &table), (absent, &empty), (pour, &empty)] {
        if let Some(answer) = ask(backend, case, inventory, &mut laws) {
            let n = inventory.clusters.len();
            let refused = matches!(answer, FunctionalityAnswer::Refuse { .. });
            laws.check(refused, || {
                format!("{case:?} with {n} things on the table: an absent object is not refused but {answer:?}")
            });
        }
    }
    // The answers to these are free, the laws of an answer hold all the same.
    let long = format!("pick up {} bottle", "the very ".repeat(400));
    for sentence in ["pick it up", "the", "?!", "qwzx vbnm", "Gib mir die Flasche, bitte! \u{1f37e}", &long] {
        ask(backend, sentence, &table, &mut laws);
    }
    laws.into_result()
}

const BOTTLE: u32 = 0;
const BOWL: u32 = 1;

fn bottle_and_bowl() -> SceneInventory {
    let cluster = |id, y: f64, size: [f64; 3], colour, shape, names: [(&str, f64); 2]| ObjectCluster {
        id,
        size_m: Vector::from(size),
        yaw_rad: 0.0,
        centre_in_base: Point::new(0.65, y, TABLE_HEIGHT_M + size[2] / 2.0),
        colour,
        shape,
        names: names.map(|(name, score)| RankedName { name: name.to_owned(), score }).into(),
        points_in_base: Vec::new(),
    };
    let bottle = [("bottle", 0.9), ("can", 0.4)];
    let bowl = [("bowl", 0.9), ("plate", 0.3)];
    SceneInventory {
        clusters: vec![
            cluster(BOTTLE, 0.15, [0.07, 0.07, 0.22], ColourName::Green, ShapeClass::UprightCylinder, bottle),
            cluster(BOWL, -0.15, [0.16, 0.16, 0.07], ColourName::White, ShapeClass::WideRound, bowl),
        ],
        table_height_m: TABLE_HEIGHT_M,
    }
}

/// The answer, twice the same and lawful; `None` after an error or a text that is no instruction.
fn ask(backend: &mut dyn LlmBackend, sentence: &str, inventory: &SceneInventory, laws: &mut Laws) -> Option<FunctionalityAnswer> {
    let case: String = sentence.chars().take(40).collect();
    let instruction = Instruction::new(sentence).ok()?;
    let request = FunctionalityRequest { instruction: &instruction, inventory };
    let answer = laws.ok(&case, backend.infer(&request))?;
    let again = laws.ok(&case, backend.infer(&request));
    laws.check(again.as_ref() == Some(&answer), || format!("{case:?}: the same question got two different answers"));
    match &answer {
        FunctionalityAnswer::Act(plan) => check_plan(&case, plan, inventory, laws),
        FunctionalityAnswer::Ask { question, choices } => {
            laws.check(!question.trim().is_empty(), || format!("{case:?}: it asks nothing"));
            laws.check(choices.len() >= 2, || format!("{case:?}: it asks and leaves {} choices", choices.len()));
        }
        FunctionalityAnswer::Refuse { reason } => {
            laws.check(!reason.trim().is_empty(), || format!("{case:?}: it refuses without a reason"));
        }
    }
    Some(answer)
}

fn check_plan(case: &str, plan: &GraspFunctionality, inventory: &SceneInventory, laws: &mut Laws) {
    let object = plan.object.cluster_id;
    laws.check(inventory.cluster(object).is_some(), || format!("{case:?}: it holds thing {object}, which is not there"));
    if let Some(target) = &plan.target {
        let id = target.cluster_id;
        laws.check(inventory.cluster(id).is_some(), || format!("{case:?}: it acts on thing {id}, which is not there"));
        laws.check(id != object, || format!("{case:?}: object and target are the same thing"));
    }
    laws.check(!plan.affordance.trim().is_empty(), || format!("{case:?}: it names no part to hold"));
    laws.check((0.0..=1.0).contains(&plan.confidence), || format!("{case:?}: confidence {} is outside [0, 1]", plan.confidence));
    laws.check(!plan.rationale.is_empty(), || format!("{case:?}: it gives no reasons"));
}
