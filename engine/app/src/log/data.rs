//! Grasps and episodes as a recording tells them.
#![cfg_attr(not(feature = "parquet"), expect(dead_code, reason = "written by the export to Parquet alone"))]

use crate::check::BadInput;
use anyhow::Result;
use serde_json::Value;
use sfg_record::{LogFile, RecordError};

/// One grasp that was tried.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Grasp {
    /// Word for the thing.
    pub(super) object: String,
    /// Palm at the grasp, base frame: x, y, z in metres and the unit quaternion x, y, z, w.
    pub(super) palm: [f32; 7],
    /// Arm joints when the hand had closed, radians.
    pub(super) joints: Vec<f32>,
    /// Synergy coordinates measured then.
    pub(super) c: [f32; 2],
    /// Grasp type.
    pub(super) grasp_type: String,
    /// The thing came up with the hand.
    pub(super) label: bool,
    /// Seed of the run.
    pub(super) seed: i64,
}

/// States and actions of one run at 100 Hz.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Episode {
    /// The sentence.
    pub(super) task: String,
    /// Names of the values of a state, and of an action.
    pub(super) names: [Vec<String>; 2],
    /// Measured: arm joints, motor positions.
    pub(super) states: Vec<Vec<f32>>,
    /// Asked for: arm joints, synergy, manipulation.
    pub(super) actions: Vec<Vec<f32>>,
}

fn numbers(value: &Value) -> Vec<f32> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).map(|value| value as f32).collect()
}

/// The last message at or before `secs`.
fn latest(messages: &[(f64, Value)], secs: f64) -> Option<&Value> {
    messages.get(messages.partition_point(|(at, _)| *at <= secs).checked_sub(1)?).map(|(_, message)| message)
}

/// The grasps of a run in the order in which the hand closed.
pub(super) fn grasps(file: &LogFile) -> Result<Vec<Grasp>, RecordError> {
    let (candidates, functionality) = (file.json("/candidates")?, file.json("/functionality")?);
    let (robot, synergy) = (file.json("/robot")?, file.json("/synergy")?);
    let selected: Vec<(f64, Value)> = candidates.into_iter().filter(|(_, message)| message["chosen"].is_u64()).collect();
    let seed = file.metadata.get("seed").and_then(|seed| seed.parse().ok()).unwrap_or(0);
    let mut grasps: Vec<Grasp> = Vec::new();
    for (secs, stage) in file.json("/stages")? {
        match stage["stage"].as_str() {
            Some("close_hand") => {
                let (Some(message), Some(answer)) = (latest(&selected, secs), latest(&functionality, secs)) else { continue };
                let act = &answer["answer"]["act"];
                let chosen = &message["candidates"][message["chosen"].as_u64().unwrap_or(0) as usize]["base_from_palm"];
                let mut palm = [0.0; 7];
                let pose = numbers(&chosen["translation"]).into_iter().chain(numbers(&chosen["rotation"]));
                palm.iter_mut().zip(pose).for_each(|(place, value)| *place = value);
                let c = latest(&synergy, secs);
                let coordinate = |key: &str| c.and_then(|c| c[key].as_f64()).unwrap_or(0.0) as f32;
                grasps.push(Grasp {
                    object: act["object"]["name"].as_str().unwrap_or_default().to_owned(),
                    palm,
                    joints: latest(&robot, secs).map_or(Vec::new(), |sample| numbers(&sample["q"])),
                    c: [coordinate("c1"), coordinate("c2")],
                    grasp_type: act["grasp_type"].as_str().unwrap_or_default().to_owned(),
                    label: false,
                    seed,
                });
            }
            Some("lift") if stage["failure"].is_null() => {
                if let Some(last) = grasps.last_mut() {
                    last.label = true;
                }
            }
            _ => {}
        }
    }
    Ok(grasps)
}

/// The run as one episode.
pub(super) fn episode(file: &LogFile) -> Result<Episode> {
    let header = file.json("/run")?.into_iter().next().map(|(_, header)| header).unwrap_or_default();
    let arm: Vec<String> = header["arm_q"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|q| header["q_names"][q.as_u64()? as usize].as_str().map(str::to_owned))
        .collect();
    let named = |more: [&str; 2]| arm.iter().cloned().chain(more.map(str::to_owned)).collect::<Vec<_>>();
    let mut episode = Episode {
        task: file.metadata.get("instruction").cloned().unwrap_or_default(),
        names: [named(["hand_motor_1", "hand_motor_2"]), named(["hand_synergy", "hand_manipulation"])],
        ..Episode::default()
    };
    for (_, sample) in file.json("/robot")? {
        let mut state = numbers(&sample["q"]);
        state.extend(numbers(&sample["hand"]["motor_positions"]));
        let mut action = numbers(&sample["q_command"]);
        action.extend(["synergy", "manipulation"].map(|key| sample["hand_command"][key].as_f64().unwrap_or(0.0) as f32));
        if state.len() != episode.names[0].len() || action.len() != episode.names[1].len() {
            let message =
                format!("{}: a message of /robot has not the joints of /run: the file is damaged", file.path().display());
            return Err(BadInput(message).into());
        }
        episode.states.push(state);
        episode.actions.push(action);
    }
    if episode.states.is_empty() {
        return Err(BadInput(format!("{} has no /robot messages to export", file.path().display())).into());
    }
    Ok(episode)
}
