//! `state.json`: where a run stopped, for `sfg run --resume`.
//!
//! The tree and its blackboard are saved as they were. A robot stands where it stopped; the simulator is brought there again by
//! sending it the same set points, which ends in the same state because it is seeded.

use crate::check::BadInput;
use crate::run::RunRequest;
use anyhow::{Context as _, Result};
use serde_json::{Value, json};
use sfg_record::{json_of, literal_of};
use sfg_tree::TreeState;
use sfg_types::RobotCommand;
use std::path::Path;

/// Name of the file in the run's folder.
pub(crate) const FILE: &str = "state.json";
/// Layout of the file.
const VERSION: u64 = 1;

/// Where a run stopped.
pub(crate) struct Stopped {
    /// The tree before it was halted.
    pub(crate) tree: TreeState,
    /// Every set point sent so far.
    pub(crate) sent: Vec<RobotCommand>,
    /// The scene's own name of the thing that was chosen; for the judge.
    pub(crate) meant: Option<String>,
}

/// A stopped run and what was run.
pub(crate) struct StoppedRun {
    pub(crate) stopped: Stopped,
    pub(crate) scenario: String,
    pub(crate) scenario_sha256: String,
    pub(crate) instruction: String,
    pub(crate) seed: u64,
}

impl Stopped {
    /// Writes the file whole or not at all.
    pub(crate) fn write(&self, folder: &Path, request: &RunRequest<'_>) -> Result<()> {
        let scenario = request.scenario;
        let state = json!({
            "version": VERSION,
            "scenario": scenario.path().display().to_string(),
            "scenario_sha256": sfg_skills::context::hash_bytes(scenario.full_text().as_bytes()),
            "instruction": request.instruction.as_str(),
            "seed": request.seed,
            "meant": self.meant,
            "tree": json_of(&self.tree.to_literal()),
            "sent": self.sent,
        });
        let path = folder.join(FILE);
        let unfinished = folder.join("state.json.part");
        std::fs::write(&unfinished, serde_json::to_vec(&state)?)
            .with_context(|| format!("cannot write {}", unfinished.display()))?;
        std::fs::rename(&unfinished, &path).with_context(|| format!("cannot write {}", path.display()))
    }
}

/// The stopped run in a folder.
pub(crate) fn read(folder: &Path) -> Result<StoppedRun> {
    let path = folder.join(FILE);
    let wrong = |what: String| BadInput(format!("{}: {what}", path.display()));
    let text = std::fs::read(&path)
        .map_err(|error| wrong(format!("{error}; a run that was stopped by Ctrl-C or --stop-after leaves this file")))?;
    let state: Value = serde_json::from_slice(&text).map_err(|error| wrong(error.to_string()))?;
    if state["version"] != VERSION {
        return Err(wrong(format!("version {} is not known; this program writes {VERSION}", state["version"])).into());
    }
    let field = |name: &str| {
        let found = state[name].as_str().map(str::to_owned);
        found.ok_or_else(|| wrong(format!("{name:?}: expected a text")))
    };
    let tree = literal_of(&state["tree"]).ok_or_else(|| wrong("\"tree\" is missing".to_owned()))?;
    let tree = TreeState::from_literal(&tree).map_err(|error| wrong(format!("\"tree\": {error}")))?;
    let sent: Vec<RobotCommand> =
        serde_json::from_value(state["sent"].clone()).map_err(|error| wrong(format!("\"sent\": {error}")))?;
    let seed = state["seed"].as_u64().ok_or_else(|| wrong("\"seed\": expected a whole number".to_owned()))?;
    let meant = state["meant"].as_str().map(str::to_owned);
    Ok(StoppedRun {
        stopped: Stopped { tree, sent, meant },
        scenario: field("scenario")?,
        scenario_sha256: field("scenario_sha256")?,
        instruction: field("instruction")?,
        seed,
    })
}
