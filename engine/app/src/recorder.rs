//! What a run leaves in `run.mcap`: turns its artefacts into messages, each at its rate.
//!
//! It looks on and decides nothing: it never takes a look of its own, and a run is the same with and without it.

mod header;

use crate::run::RunRequest;
use crate::say::say;
use anyhow::{Context as _, Result};
use sfg_driver_sim::world::{ContactTruth, JudgeHandle, SceneSpec};
use sfg_planning::Intervention;
use sfg_record::messages::{
    Candidates, Contact, Functionality, Inventory, KeyPoint, MaskView, Masks, MotorSample, RobotSample, SynergySample,
    TreeDefinition, TruthSample, Verdict,
};
use sfg_record::{Detail, Recording, TreeOutcome};
use sfg_skills::SkillContext;
use sfg_tree::{NamedRecord, Tree};
use sfg_types::layout::PoseLayout;
use sfg_types::{
    AffordanceMask, HandCommand, HandFeedback, HandProfile, Observation, PalmPoseCandidate, Point, Pose, Rejected, RobotState,
    RunReport, SceneInventory, Selection, StageRecord, TaskKeyPoint, Vector,
};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

const ROBOT_EVERY_SECS: f64 = 0.01;
const FRAMES_EVERY_SECS: f64 = 1.0 / 30.0;
const GRAINS_EVERY_SECS: f64 = 0.1;
/// Also where none has moved, so that a viewer that jumps to a moment has them soon.
const GRAINS_AT_LEAST_EVERY_SECS: f64 = 1.0;
const LOOK_EVERY_SECS: f64 = 0.5;

/// The recording of one run and what it holds already.
pub(crate) struct Recorder {
    recording: Recording,
    /// How each node went, for the page.
    outcome: TreeOutcome,
    /// What the recording says about the run as a whole.
    metadata: BTreeMap<String, String>,
    hand_q: Vec<usize>,
    robot_secs: f64,
    frames_secs: f64,
    grains_secs: f64,
    /// The grains as they were last written, and when.
    grains: (Vec<[f64; 3]>, f64),
    look_secs: f64,
    look: Option<Arc<Observation>>,
    inventory: Option<Arc<SceneInventory>>,
    masks: Option<Arc<Vec<AffordanceMask>>>,
    key_point: Option<Arc<TaskKeyPoint>>,
    candidates: Option<Arc<Vec<PalmPoseCandidate>>>,
    selection: Option<Arc<Selection>>,
    rejected: Option<Arc<Vec<Rejected>>>,
}

/// Whether the artefact is another one than `old`, which it then becomes.
fn is_new<T>(old: &mut Option<Arc<T>>, new: Option<&Arc<T>>) -> bool {
    let is_same = match (&*old, new) {
        (Some(old), Some(new)) => Arc::ptr_eq(old, new),
        (_, None) => true,
        (None, Some(_)) => false,
    };
    if !is_same {
        *old = new.cloned();
    }
    !is_same
}

/// Whether something is due that happens every `every_secs`; then it counts from now.
fn is_due(last_secs: &mut f64, now_secs: f64, every_secs: f64) -> bool {
    let is_due = now_secs - *last_secs >= every_secs - 1e-9;
    if is_due {
        // On the grid of its rate, which the control period may not divide.
        let missed = ((now_secs - *last_secs) / every_secs + 1e-6).floor();
        *last_secs = if last_secs.is_finite() { *last_secs + missed * every_secs } else { now_secs };
    }
    is_due
}

impl Recorder {
    /// Opens the recording in `folder`, and the live socket if the user asked for it.
    pub(crate) fn open(folder: &Path, request: &RunRequest<'_>, scene: &SceneSpec, profile: &HandProfile) -> Result<Self> {
        let metadata = metadata(request)?;
        let path = folder.join("run.mcap");
        let recording = match request.foxglove {
            Some(port) => {
                let (recording, port) = Recording::create_served(&path, &metadata, port)?;
                say!("Foxglove can look on at ws://127.0.0.1:{port}");
                recording
            }
            None => Recording::create(&path, &metadata)?,
        };
        let mut recording = recording.with_tap(request.tap.clone());
        recording.begin(&header::header(request, scene, profile))?;
        for (name, media_type, path) in header::files(request) {
            if let Ok(bytes) = std::fs::read(&path) {
                recording.attach(&name, media_type, &bytes)?;
            }
        }
        let never = f64::NEG_INFINITY;
        Ok(Self {
            recording,
            outcome: TreeOutcome::default(),
            metadata,
            hand_q: header::hand_q(request.model, request.scenario.arm, profile),
            robot_secs: never,
            frames_secs: never,
            grains_secs: never,
            grains: (Vec::new(), never),
            look_secs: never,
            look: None,
            inventory: None,
            masks: None,
            key_point: None,
            candidates: None,
            selection: None,
            rejected: None,
        })
    }

    /// The tree as it is built, at the start and after a reload.
    pub(crate) fn tree(&mut self, tree: &Tree<SkillContext>) -> Result<()> {
        self.outcome.extend(tree.definition().map(|node| (tree.path(node.id), node)));
        Ok(self.recording.definition(tree.now_secs(), &TreeDefinition::of(tree))?)
    }

    /// How each node went so far, and settings and hashes by name.
    pub(crate) fn outcome(&self) -> (TreeOutcome, Vec<(String, String)>) {
        (self.outcome.clone(), self.metadata.clone().into_iter().collect())
    }

    /// What happened in the tree.
    pub(crate) fn changes(&mut self, records: &[NamedRecord]) -> Result<()> {
        self.outcome.add(records);
        Ok(self.recording.changes(records)?)
    }

    /// The stages that ended in a tick and the artefacts that came of them.
    pub(crate) fn stages(&mut self, stages: &[StageRecord], skills: &SkillContext) -> Result<()> {
        let Some(stamp_secs) = stages.last().map(|stage| stage.stamp_secs) else { return Ok(()) };
        let kept = &skills.kept;
        // What was decided was decided on this look.
        if is_new(&mut self.look, kept.last_observation.as_ref())
            && let Some(look) = &self.look
        {
            self.look_secs = stamp_secs;
            self.recording.observation(look, Detail::Full)?;
        }
        if is_new(&mut self.inventory, kept.inventory.as_ref())
            && let Some(inventory) = &self.inventory
        {
            self.recording.inventory(&Inventory { stamp_secs, inventory })?;
        }
        if stages.iter().any(|stage| stage.stage == "infer_functionality")
            && let Some(answer) = &kept.answer
        {
            self.recording.functionality(&Functionality { stamp_secs, answer })?;
        }
        let is_mask_new = is_new(&mut self.masks, kept.masks.as_ref());
        let is_key_point_new = is_new(&mut self.key_point, kept.key_point.as_ref());
        if is_mask_new {
            self.masks(stamp_secs, false)?;
        }
        if is_key_point_new {
            self.masks(stamp_secs, true)?;
        }
        if let Some(key_point) = self.key_point.as_ref().filter(|_| is_key_point_new) {
            let point_in_base = key_point.point_in_base.coords.into();
            self.recording.key_point(&KeyPoint { stamp_secs, point_in_base, n_pixels: key_point.n_pixels })?;
        }
        let is_generated = is_new(&mut self.candidates, kept.candidates.as_ref());
        let is_selected = is_new(&mut self.selection, kept.selection.as_ref());
        let is_rejected = is_new(&mut self.rejected, kept.rejected.as_ref());
        let Some(candidates) = self.candidates.as_ref().filter(|_| is_generated || is_selected || is_rejected) else {
            return stages.iter().try_for_each(|stage| Ok(self.recording.stage(stage)?));
        };
        if is_generated {
            self.recording.candidates(&Candidates::new(stamp_secs, candidates, &[]))?;
        }
        if let Some(selection) = self.selection.as_ref().filter(|_| is_selected) {
            let mut message = Candidates::new(stamp_secs, candidates, &selection.rejected);
            message.chosen = Some(selection.chosen.candidate_idx);
            let way = selection.chosen.transit.q.iter().chain(&selection.chosen.approach.q);
            message.path = way.map(|q| skills.robot.chain().fk(q).translation.vector.into()).collect();
            self.recording.candidates(&message)?;
        } else if let Some(rejected) = self.rejected.as_ref().filter(|_| is_rejected) {
            self.recording.candidates(&Candidates::new(stamp_secs, candidates, rejected))?;
        }
        stages.iter().try_for_each(|stage| Ok(self.recording.stage(stage)?))
    }

    /// The masks, with the key point once it is known.
    fn masks(&mut self, stamp_secs: f64, with_key_point: bool) -> Result<()> {
        let (Some(masks), Some(look)) = (&self.masks, &self.look) else { return Ok(()) };
        let point = self.key_point.as_ref().filter(|_| with_key_point).map(|key_point| key_point.point_in_base);
        let view = |mask: &AffordanceMask| {
            let seen = look.views.iter().find(|view| view.camera == mask.camera);
            let pixel = seen
                .zip(point)
                .and_then(|(view, point): (_, Point)| view.intrinsics.project(&(view.base_from_camera.inverse() * point)));
            MaskView::new(mask, pixel.map(|pixel| [pixel.x, pixel.y]))
        };
        Ok(self.recording.masks(&Masks { stamp_secs, views: masks.iter().map(view).collect() })?)
    }

    /// What the safety filter changed.
    pub(crate) fn intervention(&mut self, stamp_secs: f64, found: &Intervention) {
        self.recording.warn(stamp_secs, "safety", found.to_string());
    }

    /// A control period: whatever is due.
    pub(crate) fn period(&mut self, skills: &SkillContext, judge: &JudgeHandle) -> Result<()> {
        let (state, sent) = (skills.robot.state(), skills.robot.sent());
        let now_secs = state.stamp_secs;
        if is_due(&mut self.robot_secs, now_secs, ROBOT_EVERY_SECS) {
            // Finer than the encoders; more digits are noise in the file.
            let fine = |values: &[f64]| values.iter().map(|value| rounded_to(1e6, *value)).collect::<Vec<_>>();
            let hand = HandFeedback {
                motor_positions: state.hand.motor_positions.map(|value| rounded_to(1e5, value)),
                motor_currents_amps: state.hand.motor_currents_amps.map(|value| rounded_to(1e5, value)),
            };
            let state = RobotState { q: fine(&state.q), dq: fine(&state.dq), hand, ..state.clone() };
            let q_command = fine(&sent.q);
            let hand_command = HandCommand {
                synergy: rounded_to(1e5, sent.hand.synergy),
                manipulation: rounded_to(1e5, sent.hand.manipulation),
            };
            self.recording.robot(&RobotSample { state: &state, q_command: &q_command, hand_command })?;
        }
        if is_due(&mut self.frames_secs, now_secs, FRAMES_EVERY_SECS) {
            let c = skills.robot.synergy();
            let [position_1, position_2] = state.hand.motor_positions.map(|value| rounded_to(1e5, value));
            let synergy = SynergySample {
                stamp_secs: now_secs,
                c1: rounded_to(1e5, c.c1),
                c2: rounded_to(1e5, c.c2),
                c1_command: rounded_to(1e5, sent.hand.synergy),
                c2_command: rounded_to(1e5, sent.hand.manipulation),
            };
            let [current_1_amps, current_2_amps] = state.hand.motor_currents_amps.map(|value| rounded_to(1e5, value));
            let motors = MotorSample { stamp_secs: now_secs, position_1, position_2, current_1_amps, current_2_amps };
            self.recording.hand(&synergy, &motors)?;
            let truth = self.truth(now_secs, judge);
            let mut q = skills.robot.model().q_with_arm(state.side, &state.q);
            for (place, value) in self.hand_q.iter().zip(&truth.hand_q) {
                q[*place] = *value;
            }
            self.recording.transforms(now_secs, &q, Some(&truth))?;
        }
        if skills.kept.last_observation.as_ref().is_some_and(|look| self.look.as_ref().is_none_or(|old| !Arc::ptr_eq(old, look)))
            && is_due(&mut self.look_secs, now_secs, LOOK_EVERY_SECS)
        {
            self.look.clone_from(&skills.kept.last_observation);
            if let Some(look) = &self.look {
                self.recording.observation(look, Detail::Glance)?;
            }
        }
        Ok(())
    }

    fn truth(&mut self, now_secs: f64, judge: &JudgeHandle) -> TruthSample {
        let truth = judge.truth();
        let millimetre = |point: &Point| [point.x, point.y, point.z].map(|metres| rounded_to(1e3, metres));
        let mut grains = None;
        if is_due(&mut self.grains_secs, now_secs, GRAINS_EVERY_SECS) {
            let places: Vec<_> = truth.grains_in_base.iter().map(millimetre).collect();
            if places != self.grains.0 || now_secs - self.grains.1 >= GRAINS_AT_LEAST_EVERY_SECS {
                self.grains = (places.clone(), now_secs);
                grains = Some(places);
            }
        }
        TruthSample {
            stamp_secs: now_secs,
            objects: truth.objects.iter().map(|object| rounded(&object.base_from_object)).collect(),
            hand_q: truth.hand_joints.iter().map(|(_, value)| rounded_to(1e5, *value)).collect(),
            grains,
            contacts: contacts(truth.contacts),
        }
    }

    /// The verdict; closes the file.
    pub(crate) fn finish(self, report: &RunReport) -> Result<()> {
        let verdict = Verdict { outcome: report.outcome, predicates: &report.predicates, judge: &report.judge };
        Ok(self.recording.finish(report.duration_secs, &verdict)?)
    }
}

fn rounded_to(steps_per_unit: f64, value: f64) -> f64 {
    (value * steps_per_unit).round() / steps_per_unit
}

/// One entry a pair that presses on each other, with the sum of its impulses, at their middle.
fn contacts(all: Vec<ContactTruth>) -> Vec<Contact> {
    let mut pairs: BTreeMap<(String, String), (f64, Vector)> = BTreeMap::new();
    for contact in all.into_iter().filter(|contact| contact.impulse_ns > 0.0) {
        let (impulse_ns, moment) = pairs.entry((contact.object, contact.with)).or_default();
        *impulse_ns += contact.impulse_ns;
        *moment += contact.impulse_ns * contact.point_in_base.coords;
    }
    let entry = |((object, with), (impulse_ns, moment)): ((String, String), (f64, Vector))| {
        let point_in_base = (moment / impulse_ns).map(|metres| rounded_to(1e4, metres)).into();
        Contact { object, with, impulse_ns: rounded_to(1e5, impulse_ns), point_in_base }
    };
    pairs.into_iter().map(entry).collect()
}

/// A pose to the micrometre: more is noise in the file.
fn rounded(pose: &Pose) -> PoseLayout {
    let micro = |value: f64| rounded_to(1e6, value);
    let exact = PoseLayout::from(pose);
    PoseLayout { rotation: exact.rotation.map(micro), translation: exact.translation.map(micro) }
}

fn metadata(request: &RunRequest<'_>) -> Result<BTreeMap<String, String>> {
    let scenario = request.scenario;
    let mut metadata = BTreeMap::from([
        ("scenario".to_owned(), scenario.path().display().to_string()),
        ("scenario_sha256".to_owned(), sfg_skills::context::hash_bytes(scenario.full_text().as_bytes())),
        ("seed".to_owned(), request.seed.to_string()),
        ("engine_version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("instruction".to_owned(), request.instruction.as_str().to_owned()),
    ]);
    let program = std::env::current_exe().and_then(std::fs::read).context("cannot read this program for its hash")?;
    metadata.insert("binary_sha256".to_owned(), sfg_skills::context::hash_bytes(&program));
    // Given when the program is built: SFG_COMMIT=$(git rev-parse HEAD) cargo build.
    if let Some(commit) = option_env!("SFG_COMMIT") {
        metadata.insert("commit".to_owned(), commit.to_owned());
    }
    if request.resumed.is_some() {
        metadata.insert("resumed".to_owned(), "true".to_owned());
    }
    Ok(metadata)
}

#[cfg(test)]
mod tests {
    use super::is_due;

    #[test]
    fn rates_are_kept_though_the_period_does_not_divide_them() {
        let mut last_secs = f64::NEG_INFINITY;
        let n_due = (0..1000).filter(|n| is_due(&mut last_secs, f64::from(*n) * 0.004, 1.0 / 30.0)).count();
        assert!((119..=121).contains(&n_due), "{n_due} in 4 s at 30 Hz");
    }
}
