//! One run: scenario and seed in, report out.

use crate::assets::Assets;
use crate::check::BadInput;
use crate::gate::Gate;
use crate::recorder::Recorder;
use crate::say::{chain, say};
use crate::scene::draw_scene;
use crate::sensed;
use crate::stopped::Stopped;
use crate::{pictures, plugins};
use anyhow::{Context as _, Result};
use sfg_driver_sim::world::{GraspAsked, JudgeHandle, Predicate, SceneSpec, Viewpoint};
use sfg_driver_sim::{SimDriver, SimOptions};
use sfg_kinematics::RobotModel;
use sfg_kinematics::reach::ReachMap;
use sfg_monitor::{Control, Go};
use sfg_planning::{FilterSettings, PalmBox};
use sfg_record::{PageParts, Tap};
use sfg_scenario::Scenario;
use sfg_skills::{Kept, Robot, RobotError, SkillContext, StageLog};
use sfg_synergy::SynergySpace;
use sfg_tree::groot::{BtlogWriter, Server};
use sfg_tree::{Change, EditError, JournalLevel, NamedRecord, Names, Registry, Status, Tree};
use sfg_types::{
    FailureReason, FunctionalityAnswer, HandProfile, Instruction, Outcome, PredicateResult, RobotCommand, RunFailure, RunReport,
    SafetyReport, StageRecord,
};
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Version of `report.json`.
const REPORT_SCHEMA_VERSION: u32 = 1;
/// Time given to a halted arm to come to rest before the recording is closed.
const REST_SECS: f64 = 0.6;
/// A changed scenario is looked for so often, in robot time.
const WATCH_EVERY_SECS: f64 = 0.2;
/// Grains that were set in motion come to rest before the judge looks.
const JUDGE_AFTER_SECS: f64 = 1.0;

/// What to run.
pub(crate) struct RunRequest<'a> {
    /// Checked scenario.
    pub(crate) scenario: &'a Scenario,
    /// The nodes it was checked with.
    pub(crate) registry: &'a Registry<SkillContext>,
    /// Robots and objects.
    pub(crate) assets: &'a Assets,
    /// Robot of the scenario.
    pub(crate) model: &'a RobotModel,
    /// Reachability map of the acting arm, where there is one.
    pub(crate) reach: Option<Arc<ReachMap>>,
    /// What the user says.
    pub(crate) instruction: Instruction,
    /// Seed of everything random.
    pub(crate) seed: u64,
    /// Where report, recording and pictures go; `None` writes nothing.
    pub(crate) folder: Option<PathBuf>,
    /// Set by Ctrl-C.
    pub(crate) interrupted: &'a AtomicBool,
    /// What tests change about the simulator.
    pub(crate) simulator: Simulator<'a>,
    /// Where an earlier run stopped, to go on from there.
    pub(crate) resumed: Option<&'a Stopped>,
    /// Stops, as Ctrl-C does, when this stage has ended.
    pub(crate) stop_after: Option<&'a str>,
    /// Port at which Groot2 can look on.
    pub(crate) groot2: Option<u16>,
    /// Port at which Foxglove can look on.
    pub(crate) foxglove: Option<u16>,
    /// Whether the folder gets a run.mcap.
    pub(crate) is_recorded: bool,
    /// Listens to what is recorded, while it is.
    pub(crate) tap: Option<Tap>,
    /// What the page's user asks for between ticks.
    pub(crate) control: Option<&'a Control>,
    /// Called now and then between ticks; a scenario that it gives takes the place of the running one.
    pub(crate) watch: &'a dyn Fn() -> Option<Scenario>,
    /// Called at the end of each stage.
    pub(crate) on_stage: &'a dyn Fn(&StageRecord, f64),
}

/// The simulator's options, and a last change to the scene after it was loaded and before the robot first looks.
#[derive(Clone)]
pub(crate) struct Simulator<'a> {
    pub(crate) options: SimOptions,
    pub(crate) prepare: &'a dyn Fn(JudgeHandle) -> JudgeHandle,
}

impl Default for Simulator<'_> {
    fn default() -> Self {
        Self { options: SimOptions::default(), prepare: &|judge| judge }
    }
}

/// Runs a scenario in the simulator and judges it.
pub(crate) fn run(request: &RunRequest<'_>) -> Result<RunReport> {
    let begun = Instant::now();
    let spec = draw_scene(request.scenario, request.assets, request.seed).map_err(|error| BadInput(chain(&error)))?;
    let (driver, judge) = SimDriver::new(&spec, request.model, request.scenario.arm, request.simulator.options.clone())
        .map_err(|error| BadInput(error.to_string()))?;
    let judge = (request.simulator.prepare)(judge);
    let profile = request.model.hand_profile.clone().context("the robot has no hand profile")?;
    let synergy = SynergySpace::new(&profile)?;
    let limits = &request.scenario.limits;
    let mut settings = FilterSettings::default();
    if let Some(workspace) = &limits.workspace {
        settings.palm_box = PalmBox {
            low_m: [workspace.x_m.min, workspace.y_m.min, workspace.z_m.min],
            high_m: [workspace.x_m.max, workspace.y_m.max, workspace.z_m.max],
        };
    }
    let robot = Robot::new(Box::new(driver), request.model.clone(), synergy.clone(), settings, limits.max_joint_speed_fraction)?
        .with_reach(request.reach.clone());
    let context =
        plugins::PluginSetting { assets: request.assets, profile: &profile, scenario: request.scenario, seed: request.seed };
    let mut skills = SkillContext {
        robot,
        plugins: plugins::make(&context)?,
        instruction: request.instruction.clone(),
        synergy,
        seed: request.seed,
        log: StageLog::default(),
        kept: Kept::default(),
    };
    let mut session = Session {
        request,
        judge,
        recorder: None,
        at_grasp: None,
        meant: None,
        stage_wall: Vec::new(),
        names: None,
        btlog: None,
        groot2: None,
        begun,
        sent: Vec::new(),
        safety: SafetyReport::default(),
    };
    session.open_recording(&spec, &profile)?;
    let ready_secs = begun.elapsed().as_secs_f64();
    // Nothing moves on unrecorded.
    let ended = session.tick_to_end(&mut skills).inspect_err(|_| drop(skills.robot.stop_and_wait()))?;
    let report = session.report(&mut skills, ended, ready_secs)?;
    Ok(report)
}

/// How the tree came to its end.
struct Ended {
    status: Status,
    failure: Option<RunFailure>,
    is_interrupted: bool,
    first_motion_secs: Option<f64>,
}

struct Session<'a> {
    request: &'a RunRequest<'a>,
    judge: JudgeHandle,
    recorder: Option<Recorder>,
    at_grasp: Option<Vec<u8>>,
    /// The scene's own name of what stood where the robot saw the thing that it chose.
    meant: Option<String>,
    stage_wall: Vec<(String, f64)>,
    /// Names of the tree's nodes, for the journal.
    names: Option<Names>,
    /// The log of status changes that Groot2 opens.
    btlog: Option<BtlogWriter<BufWriter<File>>>,
    groot2: Option<Server>,
    /// Every set point sent, so that a simulated robot can be brought here again.
    sent: Vec<RobotCommand>,
    safety: SafetyReport,
    begun: Instant,
}

impl Session<'_> {
    fn open_recording(&mut self, scene: &SceneSpec, profile: &HandProfile) -> Result<()> {
        let Some(folder) = &self.request.folder else { return Ok(()) };
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the run folder {}; choose another with --out", folder.display()))?;
        if self.request.is_recorded {
            self.recorder = Some(Recorder::open(folder, self.request, scene, profile)?);
        }
        // A report of an earlier run would belong to another recording.
        for name in ["report.json", "report.html", crate::stopped::FILE] {
            drop(std::fs::remove_file(folder.join(name)));
        }
        Ok(())
    }

    /// Brings robot and tree to where an earlier run stopped.
    fn go_on(&mut self, tree: &mut Tree<SkillContext>, stopped: &Stopped, skills: &mut SkillContext) -> Result<()> {
        let lost = tree.check_resume(&stopped.tree);
        if !lost.is_empty() {
            let list: Vec<String> = lost.iter().map(|error| format!("  {error}")).collect();
            return Err(BadInput(format!("the run cannot be resumed; nothing has moved\n{}", list.join("\n"))).into());
        }
        for command in &stopped.sent {
            skills
                .robot
                .repeat(command)
                .map_err(|error| BadInput(format!("the robot cannot be brought to where it was: {error}")))?;
        }
        let (now_secs, then_secs) = (skills.robot.now_secs(), stopped.tree.now_secs);
        if now_secs < then_secs {
            let message = format!(
                "the saved set points end at {now_secs:.2} s and the tree stopped at {then_secs:.2} s: the file is damaged"
            );
            return Err(BadInput(message).into());
        }
        self.sent.clone_from(&stopped.sent);
        self.meant.clone_from(&stopped.meant);
        tree.resume(&stopped.tree, skills).map_err(|errors| BadInput(errors[0].to_string()))?;
        say!("resumed at {:.2} s", skills.robot.now_secs());
        Ok(())
    }

    /// Opens the log and the live view for Groot2.
    fn open_for_groot(&mut self, tree: &Tree<SkillContext>) -> Result<()> {
        if let Some(folder) = &self.request.folder {
            let path = folder.join("run.btlog");
            let file = File::create(&path).with_context(|| format!("cannot write {}", path.display()))?;
            let now = SystemTime::now().duration_since(UNIX_EPOCH).context("the system clock is before 1970")?;
            let start_us = i64::try_from(now.as_micros()).unwrap_or(i64::MAX);
            self.btlog = Some(BtlogWriter::for_tree(BufWriter::new(file), tree, start_us)?);
        }
        if let Some(port) = self.request.groot2 {
            self.groot2 = Some(Server::start(port, tree)?);
        }
        Ok(())
    }

    /// Ticks the tree each control period until it ends, the time is used up or the user interrupts.
    fn tick_to_end(&mut self, skills: &mut SkillContext) -> Result<Ended> {
        let mut tree = self.request.scenario.build_tree(self.request.registry)?;
        tree.set_journal_level(JournalLevel::Values);
        self.names = Some(tree.names());
        self.open_for_groot(&tree)?;
        let timeout_secs = self.request.scenario.limits.timeout_secs;
        let (mut first_motion_secs, mut watched_secs, mut state) = (None, 0.0, None);
        if let Some(stopped) = self.request.resumed {
            self.go_on(&mut tree, stopped, skills)?;
        }
        self.record(|recorder| recorder.tree(&tree))?;
        let mut gate = self.request.control.map(|control| Gate::new(control, &tree));
        let mut ended = loop {
            let is_held = match gate.as_mut().map_or(Go::Tick, |gate| gate.before_tick(&mut tree, &skills.robot)) {
                Go::Tick => false,
                Go::Hold => true,
                Go::Halt => {
                    state = Some(tree.save());
                    tree.halt(skills);
                    break Ended { status: Status::Failure, failure: None, is_interrupted: true, first_motion_secs };
                }
                Go::EmergencyStop => {
                    skills.robot.stop()?;
                    tree.halt(skills);
                    let failure = RunFailure {
                        reason: FailureReason::EmergencyStop.name().to_owned(),
                        node: "page".to_owned(),
                        explanation: "the emergency stop was pressed on the page".to_owned(),
                    };
                    break Ended { status: Status::Failure, failure: Some(failure), is_interrupted: true, first_motion_secs };
                }
            };
            let now_secs = skills.robot.now_secs();
            let mut status = Status::Running;
            if is_held {
                // Nobody watches faster than time goes.
                std::thread::sleep(Duration::from_secs_f64(skills.robot.period_secs()));
            } else {
                status = tree.tick(now_secs, skills);
                self.record_stages(skills)?;
                let has_changes = self.record_changes(&mut tree)?;
                if let Some(gate) = &gate {
                    gate.after_tick(&mut tree, has_changes);
                }
            }
            if status == Status::Running && now_secs - watched_secs >= WATCH_EVERY_SECS {
                watched_secs = now_secs;
                if self.reload(&mut tree)?
                    && let Some(gate) = &gate
                {
                    gate.show(&tree);
                }
            }
            if status != Status::Running {
                let failure = tree.failure().map(|at| RunFailure {
                    reason: at.failure.reason.to_string(),
                    node: tree.path(at.node),
                    explanation: at.failure.detail.clone(),
                });
                break Ended {
                    status,
                    failure: failure.filter(|_| status != Status::Success),
                    is_interrupted: false,
                    first_motion_secs,
                };
            }
            let is_stage_over = |stage: &&str| skills.log.records().iter().any(|record| record.stage == **stage);
            if self.request.interrupted.load(Ordering::Relaxed) || self.request.stop_after.as_ref().is_some_and(is_stage_over) {
                state = Some(tree.save());
                tree.halt(skills);
                break Ended { status: Status::Failure, failure: None, is_interrupted: true, first_motion_secs };
            }
            if now_secs - gate.as_ref().map_or(0.0, Gate::held_secs) >= timeout_secs {
                tree.halt(skills);
                let failure = RunFailure {
                    reason: FailureReason::Timeout.name().to_owned(),
                    node: "limits.timeout_secs".to_owned(),
                    explanation: format!("the run was not over after {timeout_secs} s"),
                };
                break Ended { status: Status::Failure, failure: Some(failure), is_interrupted: false, first_motion_secs };
            }
            if let Err(error) = self.advance(skills, is_held) {
                let reason = match error {
                    RobotError::Limit(_) => FailureReason::LimitViolated,
                    _ => FailureReason::DriverFailed,
                };
                let node = "driver".to_owned();
                tree.halt(skills);
                let failure = RunFailure { reason: reason.name().to_owned(), node, explanation: error.to_string() };
                break Ended { status: Status::Failure, failure: Some(failure), is_interrupted: false, first_motion_secs };
            }
            if first_motion_secs.is_none() && skills.robot.sent().dq.iter().any(|velocity| *velocity != 0.0) {
                first_motion_secs = Some(self.begun.elapsed().as_secs_f64());
            }
            if self.at_grasp.is_none() && skills.kept.base_from_palm_at_grasp.is_some() {
                self.at_grasp = self.close_up(skills)?;
            }
            self.record_period(skills)?;
        };
        // A halt changes nodes too.
        self.record_changes(&mut tree)?;
        if let Some(btlog) = self.btlog.take() {
            btlog.finish()?;
        }
        // The arm comes to rest under the engine's limits, whatever ended the run.
        let rest_secs = if ended.status == Status::Success { JUDGE_AFTER_SECS } else { REST_SECS };
        let until_secs = skills.robot.now_secs() + rest_secs;
        while skills.robot.now_secs() < until_secs {
            self.record_period(skills)?;
            if let Err(error) = self.advance(skills, false) {
                ended.failure.get_or_insert(RunFailure {
                    reason: FailureReason::DriverFailed.name().to_owned(),
                    node: "driver".to_owned(),
                    explanation: error.to_string(),
                });
                break;
            }
        }
        if let (Some(tree), Some(folder)) = (state, &self.request.folder) {
            let sent = std::mem::take(&mut self.sent);
            Stopped { tree, sent, meant: self.meant.clone() }.write(folder, self.request)?;
        }
        Ok(ended)
    }

    /// Goes on with a changed scenario, if there is one and nothing that runs would vanish; whether it did.
    fn reload(&mut self, tree: &mut Tree<SkillContext>) -> Result<bool> {
        let Some(scenario) = (self.request.watch)() else { return Ok(false) };
        match tree.reload(self.request.registry, &scenario.tree) {
            Ok(reloaded) => {
                self.names = Some(tree.names());
                // The log has the nodes of one tree.
                drop(self.btlog.take());
                if let Some(server) = &self.groot2 {
                    server.show(tree);
                }
                let list = |sign: &str, paths: &[String]| paths.iter().map(|path| format!(" {sign}{path}")).collect::<String>();
                let changes = list("+", &reloaded.added) + &list("-", &reloaded.removed);
                let changes = if changes.is_empty() { " no node came or went".to_owned() } else { changes };
                say!("reloaded the tree:{changes}");
                self.record(|recorder| recorder.tree(tree))?;
                return Ok(true);
            }
            Err(EditError::Build(_)) => say!("not reloaded: {} no longer fits", scenario.path().display()),
            Err(error) => say!("not reloaded: {error}"),
        }
        Ok(false)
    }

    /// Tells the recorder, if this run leaves a recording.
    fn record(&mut self, tell: impl FnOnce(&mut Recorder) -> Result<()>) -> Result<()> {
        self.recorder.as_mut().map_or(Ok(()), tell)
    }

    /// Lets a control period pass and keeps what was sent and what the safety filter changed.
    fn advance(&mut self, skills: &mut SkillContext, is_held: bool) -> Result<(), RobotError> {
        let advanced = if is_held { skills.robot.hold() } else { skills.robot.advance() };
        self.sent.push(skills.robot.sent().clone());
        self.safety.periods += 1;
        for (secs, found) in skills.robot.take_interventions() {
            self.safety.interventions += 1;
            *self.safety.by_limit.entry(found.limit.name().to_owned()).or_default() += 1;
            self.safety.first.get_or_insert_with(|| format!("{secs:.3} s: {found}"));
            if let Some(recorder) = &mut self.recorder {
                recorder.intervention(secs, &found);
            }
        }
        advanced
    }

    fn record_period(&mut self, skills: &SkillContext) -> Result<()> {
        let judge = self.judge.clone();
        self.record(|recorder| recorder.period(skills, &judge))
    }

    fn record_stages(&mut self, skills: &mut SkillContext) -> Result<()> {
        let ended = skills.log.take_new();
        for (stage, secs) in &ended {
            (self.request.on_stage)(stage, *secs);
            self.stage_wall.push((stage.stage.clone(), *secs));
            if stage.stage == "infer_functionality"
                && let Some(seen) = &skills.kept.object_in_base
            {
                self.meant = self.judge.object_at(seen);
            }
        }
        if ended.is_empty() {
            return Ok(());
        }
        let ended: Vec<StageRecord> = ended.into_iter().map(|(stage, _)| stage).collect();
        self.record(|recorder| recorder.stages(&ended, skills))
    }

    /// Whether a node changed its status.
    fn record_changes(&mut self, tree: &mut Tree<SkillContext>) -> Result<bool> {
        let changes = tree.drain_journal();
        let has_changes = changes.iter().any(|record| matches!(record.change, Change::Status { .. }));
        if let Some(server) = &self.groot2 {
            server.update(tree, &changes);
        }
        if let Some(btlog) = &mut self.btlog {
            btlog.records(&changes)?;
        }
        let (Some(recorder), Some(names)) = (&mut self.recorder, &self.names) else { return Ok(has_changes) };
        let changes: Vec<NamedRecord> = changes.into_iter().map(|record| names.of(record)).collect();
        recorder.changes(&changes)?;
        Ok(has_changes)
    }

    /// A simulator picture of the closed hand.
    fn close_up(&self, skills: &SkillContext) -> Result<Option<Vec<u8>>> {
        if self.request.folder.is_none() {
            return Ok(None);
        }
        let palm = skills.robot.base_from_palm();
        let target = palm * sfg_types::Point::new(0.03, 0.0, 0.03);
        let side = palm.rotation * sfg_types::Vector::new(0.25, 0.0, 0.45);
        let eye = target + sfg_types::Vector::new(side.x, side.y, 0.25);
        let viewpoint = Viewpoint { eye_in_base: eye, target_in_base: target, horizontal_fov_deg: 45.0, ..Viewpoint::default() };
        let picture = self.judge.picture(&viewpoint);
        Ok(Some(pictures::labelled(picture.width, picture.height, &picture.rgb, "the hand closed (simulator picture)")?))
    }

    fn report(&mut self, skills: &mut SkillContext, ended: Ended, ready_secs: f64) -> Result<RunReport> {
        let scenario = self.request.scenario;
        let truth: Vec<Predicate> = scenario
            .success
            .truth
            .iter()
            .map(|predicate| {
                let json = serde_json::json!({ predicate.name.clone(): predicate.args_json() });
                serde_json::from_value(json).with_context(|| format!("predicate {:?}", predicate.name))
            })
            .collect::<Result<_>>()?;
        let verdict = self.judge.verdict(&truth)?;
        let mut predicates: Vec<PredicateResult> = verdict
            .checks
            .iter()
            .map(|check| PredicateResult {
                predicate: check.name.clone(),
                evaluator: "truth".to_owned(),
                passed: check.pass,
                measured: check.detail.clone(),
            })
            .collect();
        predicates.extend(scenario.success.sensed.iter().map(|predicate| sensed::evaluate(predicate, skills)));
        let not_attempted = ended.failure.as_ref().is_some_and(|failure| {
            [FailureReason::NeedsAnswer.name(), FailureReason::Refused.name()].contains(&failure.reason.as_str())
        });
        let all_hold = |evaluator: &str| {
            predicates.iter().filter(|predicate| predicate.evaluator == evaluator).all(|predicate| predicate.passed)
        };
        let outcome = if verdict.physics_tampered.is_some() {
            Outcome::PhysicsTampered
        } else if ended.is_interrupted {
            Outcome::Interrupted
        } else if not_attempted {
            Outcome::NotAttempted
        } else if ended.status != Status::Success {
            Outcome::TreeFailure
        } else if all_hold("truth") {
            Outcome::Success
        } else {
            Outcome::JudgedFailure
        };
        let asked = match &skills.kept.answer {
            Some(FunctionalityAnswer::Act(functionality)) => Some(functionality.clone()),
            _ => None,
        };
        let judged_grasp = match &asked {
            Some(functionality) => self.judge_grasp(functionality)?,
            None => serde_json::Value::Null,
        };
        let report = RunReport {
            schema_version: REPORT_SCHEMA_VERSION,
            scenario: scenario.path().file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            scenario_sha256: sfg_skills::context::hash_bytes(scenario.full_text().as_bytes()),
            engine_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.request.seed,
            instruction: self.request.instruction.as_str().to_owned(),
            outcome,
            failure: ended.failure,
            predicates,
            judge: serde_json::json!({
                "grasp": judged_grasp,
                "physics_tampered": verdict.physics_tampered,
                "state_hash": format!("{:016x}", self.judge.state_hash()),
            }),
            stages: skills.log.records().to_vec(),
            safety: self.safety.clone(),
            duration_secs: skills.robot.now_secs(),
            timings: serde_json::json!({
                "ready_secs": ready_secs,
                "decision_secs": self.decision_secs(),
                "first_motion_secs": ended.first_motion_secs,
                "stages": self.stage_wall.iter().map(|(stage, secs)| serde_json::json!([stage, secs])).collect::<Vec<_>>(),
                "total_secs": self.begun.elapsed().as_secs_f64(),
            }),
        };
        self.write(&report, skills)?;
        Ok(report)
    }

    /// Sentence to first trajectory: the stages from the observation to the selection, the first time round.
    fn decision_secs(&self) -> f64 {
        let mut sum = 0.0;
        for (stage, secs) in &self.stage_wall {
            sum += secs;
            if stage == "synthesize_grasp" || stage == "select_palm_pose" {
                return sum;
            }
        }
        sum
    }

    /// The judge's word on the grasp.
    fn judge_grasp(&self, functionality: &sfg_types::GraspFunctionality) -> Result<serde_json::Value> {
        let Some(object) = self.meant.clone() else { return Ok(serde_json::Value::Null) };
        let asked = GraspAsked { object, part: functionality.affordance.clone(), grasp_type: functionality.grasp_type };
        Ok(serde_json::to_value(self.judge.report(&asked)?)?)
    }

    fn write(&mut self, report: &RunReport, skills: &SkillContext) -> Result<()> {
        let Some(folder) = self.request.folder.clone() else { return Ok(()) };
        let last = self.judge.picture(&Viewpoint::default());
        let result = pictures::labelled(last.width, last.height, &last.rgb, "at the end (simulator picture)")?;
        let shown = pictures::of_run(&skills.kept, result, self.at_grasp.take())?;
        let (outcome, settings) = self.recorder.as_ref().map(Recorder::outcome).unzip();
        if let Some(recorder) = self.recorder.take() {
            recorder.finish(report)?;
        }
        let settings = settings.unwrap_or_default();
        let parts = PageParts { report, pictures: &shown, tree: outcome.as_ref(), settings: &settings };
        sfg_record::write_page(&folder, &parts)?;
        sfg_record::write_report(&folder, report)?;
        Ok(())
    }
}

#[cfg(test)]
#[path = "sensors_in.rs"]
mod sensors_in;

#[cfg(test)]
#[path = "reload.rs"]
mod reload;

#[cfg(test)]
#[path = "controlled.rs"]
mod controlled;

#[cfg(test)]
#[path = "resume.rs"]
mod resume;
