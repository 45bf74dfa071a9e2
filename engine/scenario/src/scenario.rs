//! A scenario as a whole.

use crate::document::{MAX_FILE_BYTES, Node, Value};
use crate::files::{Files, read_text};
use crate::mistake::{At, Findings, Mistake, Place, ScenarioErrors, Severity, Source};
use crate::parameters::{Parameters, Settings};
use crate::plugins::Plugins;
use crate::reader::{Fields, Reader};
use crate::reasons::ReasonPlace;
use crate::review;
use crate::scene::{Range, Scene};
use crate::success::Success;
use crate::tree::{TreeReader, help_for};
use crate::vocabulary::Vocabulary;
use sfg_tree::{BuildError, Problem, Registry, Tree, TreeSpec};
use sfg_types::{HandSide, Instruction};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A checked scenario.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name of the robot.
    pub robot: At<String>,
    /// The acting arm and hand.
    pub arm: HandSide,
    /// What stands where.
    pub scene: Scene,
    /// What the robot is told, unless the command line says otherwise.
    pub instruction: Option<At<Instruction>>,
    /// Which implementations are used.
    pub plugins: Plugins,
    /// What is done.
    pub tree: TreeSpec,
    /// When it was done well.
    pub success: Success,
    /// What must never be exceeded.
    pub limits: Limits,
    /// What it probably does not mean.
    pub warnings: Findings,
    /// The scenario's own file, then those that it includes.
    pub sources: Arc<[Source]>,
    /// What was decided outside the files: parameters and variables of the environment, as given.
    pub settings: BTreeMap<String, String>,
    pub(crate) places: Vec<Place>,
}

/// Bounds of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Simulated time after which the run ends, seconds.
    pub timeout_secs: f64,
    /// Share of the robot's joint speed limits that may be used.
    pub max_joint_speed_fraction: f64,
    /// Where the palm may go; everywhere when not given.
    pub workspace: Option<Workspace>,
}

/// A box in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workspace {
    /// Ahead, metres.
    pub x_m: Range,
    /// To the left, metres.
    pub y_m: Range,
    /// Up, metres.
    pub z_m: Range,
}

impl Default for Limits {
    fn default() -> Self {
        Self { timeout_secs: 120.0, max_joint_speed_fraction: 0.5, workspace: None }
    }
}

/// What a scenario may say.
pub(crate) const KEYS: [&str; 14] = [
    "version",
    "robot",
    "arm",
    "scene",
    "instruction",
    "plugins",
    "tree",
    "subtrees",
    "success",
    "limits",
    "description",
    "include",
    "parameters",
    "blackboard",
];

impl Scenario {
    /// The scenario in the file at `path`.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the file and of those that it includes, or why it cannot be read.
    pub fn load<C>(
        path: &Path,
        settings: &Settings,
        registry: &Registry<C>,
        vocabulary: &Vocabulary,
    ) -> Result<Self, ScenarioErrors> {
        let text = read_text(path).map_err(|message| ScenarioErrors::unreadable(path, message))?;
        Self::parse(path, text, settings, registry, vocabulary)
    }

    /// The scenario in `text`; `path` is shown in messages, and what the text includes is found beside it.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the text.
    pub fn parse<C>(
        path: &Path,
        text: String,
        settings: &Settings,
        registry: &Registry<C>,
        vocabulary: &Vocabulary,
    ) -> Result<Self, ScenarioErrors> {
        if text.len() > MAX_FILE_BYTES {
            return Err(ScenarioErrors::unreadable(path, format!("it is larger than {} MB", MAX_FILE_BYTES >> 20)));
        }
        let mut reader = Reader::default();
        let mut files = Files::new(&mut reader);
        let document = files.document(path, text);
        let sources: Arc<[Source]> = files.sources.into();
        let scenario = document.and_then(|mut document| {
            let mut parameters = Parameters::new(&mut reader, settings);
            parameters.apply(&mut document);
            let taken = parameters.taken;
            read(&mut reader, &document, registry, vocabulary, Origin { sources: Arc::clone(&sources), settings: taken })
        });
        let findings = Findings::new(sources, reader.mistakes);
        match scenario {
            Some(scenario) if findings.count(Severity::Error) == 0 => Ok(Self { warnings: findings, ..scenario }),
            _ => Err(ScenarioErrors::Mistakes(findings)),
        }
    }

    /// The scenario's own file.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.sources.first().map_or(Path::new(""), |source| &source.path)
    }

    /// Everything that decides what the scenario says, for hashes: the text of its file, and if there are any, the texts that
    /// it includes and the settings from outside.
    #[must_use]
    pub fn full_text(&self) -> String {
        let mut text: Vec<&str> = self.sources.iter().map(|source| source.text.as_str()).collect();
        text.extend(self.settings.iter().flat_map(|(name, value)| [name.as_str(), value.as_str()]));
        text.join("\0")
    }

    /// A path as written in the file of `place`.
    #[must_use]
    pub fn resolve(&self, path: &At<PathBuf>) -> PathBuf {
        let file = self.sources.get(path.place.file as usize).and_then(|source| source.path.parent());
        file.unwrap_or(Path::new("")).join(&path.value)
    }

    /// The runnable tree.
    ///
    /// # Errors
    /// The mistakes that `registry` finds; none when the scenario was loaded with the same one.
    pub fn build_tree<C>(&self, registry: &Registry<C>) -> Result<Tree<C>, ScenarioErrors> {
        registry
            .build(&self.tree)
            .map_err(|errors| self.errors(errors.into_iter().map(|error| mistake_of(error, &self.places)).collect()))
    }

    /// Where a tree node was written; takes the location that the tree's definition gives.
    #[must_use]
    pub fn place(&self, location: u32) -> Option<Place> {
        self.places.get(location as usize).copied()
    }

    /// Mistakes that the application found, shown as those found here.
    #[must_use]
    pub fn errors(&self, mistakes: Vec<Mistake>) -> ScenarioErrors {
        let all = self.warnings.list().iter().cloned().chain(mistakes).collect();
        ScenarioErrors::Mistakes(Findings::new(Arc::clone(&self.sources), all))
    }
}

pub(crate) fn mistake_of(error: BuildError, places: &[Place]) -> Mistake {
    let place = places.get(error.location as usize).copied().unwrap_or(Place::START);
    Mistake { help: error.help, ..Mistake::new(place, error.problem.to_string()) }
}

/// Where a scenario comes from.
struct Origin {
    sources: Arc<[Source]>,
    settings: BTreeMap<String, String>,
}

fn read<C>(
    reader: &mut Reader,
    document: &Node,
    registry: &Registry<C>,
    vocabulary: &Vocabulary,
    origin: Origin,
) -> Option<Scenario> {
    if matches!(document.value, Value::Null) {
        reader.report_with_help(
            Place::START,
            "the scenario is empty",
            format!("it needs {}", ["version", "robot", "scene", "tree"].join(", ")),
        );
        return None;
    }
    let fields = reader.fields("scenario", document, &KEYS)?;
    reader.required("scenario", &fields, "version");
    reader.version(document);
    let robot = reader.required("scenario", &fields, "robot").and_then(|node| reader.word("robot", node, &vocabulary.robots));
    let arm = fields.get("arm").map_or(Some(HandSide::Left), |node| arm(reader, node));
    let scene = reader.required("scenario", &fields, "scene").and_then(|node| reader.scene(node, vocabulary));
    let instruction = fields.get("instruction").and_then(|node| instruction(reader, node));
    let plugins = fields.get("plugins").map_or_else(|| Some(Plugins::default()), |node| reader.plugins(node, vocabulary));
    let success = fields.get("success").map_or_else(|| Some(Success::default()), |node| reader.success(node, vocabulary));
    let limits = fields.get("limits").map_or_else(|| Some(Limits::default()), |node| limits(reader, node));
    let timeout_secs = limits.as_ref().map(|limits| limits.timeout_secs);
    let tree = read_tree(reader, &fields, registry, vocabulary, timeout_secs);
    let no_warnings = Findings::new(Arc::clone(&origin.sources), Vec::new());
    let (tree, places) = tree?;
    Some(Scenario {
        robot: robot?,
        arm: arm?,
        scene: scene?,
        instruction,
        plugins: plugins?,
        tree,
        success: success?,
        limits: limits?,
        warnings: no_warnings,
        sources: origin.sources,
        settings: origin.settings,
        places,
    })
}

/// The tree, built once so that all its mistakes are known, and the places of its nodes.
fn read_tree<C>(
    reader: &mut Reader,
    fields: &Fields<'_>,
    registry: &Registry<C>,
    vocabulary: &Vocabulary,
    timeout_secs: Option<f64>,
) -> Option<(TreeSpec, Vec<Place>)> {
    let tree = reader.required("scenario", fields, "tree");
    let mut reasons = vocabulary.reasons.clone();
    if !reasons.is_empty() {
        reasons.extend(sfg_tree::reason::ALL.iter().map(|reason| (*reason).to_owned()));
    }
    let mut trees = TreeReader {
        reader,
        models: registry.models(),
        reasons,
        subtree_ports: BTreeMap::new(),
        // Number 0 is the whole file, for nodes without a place.
        places: vec![Place::START],
        unread: BTreeSet::new(),
        entry_places: Vec::new(),
        reason_places: Vec::new(),
        spoilt: BTreeSet::new(),
    };
    let entries = fields.get("blackboard").map_or_else(|| Some(Vec::new()), |node| trees.blackboard(node));
    let subtrees = fields.get("subtrees").map_or_else(|| Some(Vec::new()), |node| trees.subtrees(node));
    let root = tree.and_then(|node| trees.node(node));
    let TreeReader { places, spoilt, unread, entry_places, reason_places, .. } = trees;
    let tree = TreeSpec { root: root?, subtrees: subtrees?, entries: entries?, ..TreeSpec::default() };
    let written = Written {
        tree: &tree,
        places: &places,
        entry_places: &entry_places,
        reason_places: &reason_places,
        spoilt: &spoilt,
        unread: &unread,
    };
    reader.mistakes.extend(check_tree(&written, registry, timeout_secs));
    Some((tree, places))
}

/// A tree and where its parts were written.
pub(crate) struct Written<'a> {
    pub(crate) tree: &'a TreeSpec,
    pub(crate) places: &'a [Place],
    /// Where the keys of the blackboard's first entries stand.
    pub(crate) entry_places: &'a [Place],
    /// Where the reasons stand that nodes wait for.
    pub(crate) reason_places: &'a [ReasonPlace],
    /// Nodes and ports that could not be read.
    pub(crate) spoilt: &'a BTreeSet<u32>,
    /// Subtrees that could not be read.
    pub(crate) unread: &'a BTreeSet<String>,
}

/// What `registry` says against the tree, and what it cannot mean.
pub(crate) fn check_tree<C>(written: &Written<'_>, registry: &Registry<C>, timeout_secs: Option<f64>) -> Vec<Mistake> {
    let Written { tree, places, entry_places, reason_places, spoilt, unread } = written;
    let mut mistakes = Vec::new();
    let (mut can_be_walked, mut has_unknown_nodes, has_unread_nodes) = (true, false, !spoilt.is_empty());
    if let Err(errors) = registry.build(tree) {
        let is_unread =
            |error: &BuildError| matches!(error.problem, Problem::UnknownNode { .. } | Problem::UnknownSubtree { .. });
        has_unknown_nodes = errors.iter().any(is_unread);
        // A node that could not be read would have had the port, the child or the key that is now missing.
        let is_consequence = |error: &BuildError| match &error.problem {
            Problem::UnknownSubtree { name } => unread.contains(name),
            Problem::MissingPort { .. } | Problem::ChildCount { .. } => spoilt.contains(&error.location),
            Problem::DanglingKey { .. } => (has_unread_nodes || has_unknown_nodes) && error.help.is_none(),
            _ => false,
        };
        let is_endless = |error: &BuildError| {
            matches!(error.problem, Problem::RecursiveSubtree { .. } | Problem::TooDeep { .. } | Problem::TooLarge { .. })
        };
        can_be_walked = !errors.iter().any(is_endless);
        mistakes.extend(errors.into_iter().filter(|error| !is_consequence(error)).map(|mut error| {
            error.help = error.help.or_else(|| help_for(&error.problem, registry.models()));
            mistake_of(error, places)
        }));
    }
    if can_be_walked {
        let entry_keys: Vec<&str> = registry.entry_keys().collect();
        let reviewed = review::Reviewed {
            tree,
            models: registry.models(),
            entry_keys: &entry_keys,
            places,
            entry_places,
            reason_places,
            has_unread_nodes,
            has_unknown_nodes,
        };
        mistakes.extend(review::review(&reviewed, timeout_secs));
    }
    mistakes
}

impl Reader {
    /// The version of the format, where it is given.
    pub(crate) fn version(&mut self, document: &Node) {
        if let Some(version) = document.get("version")
            && !matches!(version.value, Value::Int(1))
        {
            self.wrong::<()>("version", version, "1");
        }
        if let Some(description) = document.get("description") {
            self.text("description", description);
        }
    }
}

fn arm(reader: &mut Reader, node: &Node) -> Option<HandSide> {
    match &node.value {
        Value::Text(side) if side == "left" => Some(HandSide::Left),
        Value::Text(side) if side == "right" => Some(HandSide::Right),
        _ => reader.wrong("arm", node, "left or right"),
    }
}

fn instruction(reader: &mut Reader, node: &Node) -> Option<At<Instruction>> {
    let text = match &node.value {
        // Nothing after the colon is an empty sentence, and said so.
        Value::Null => At { value: String::new(), place: node.place },
        _ => reader.text("instruction", node)?,
    };
    match Instruction::new(&text) {
        Ok(value) => Some(At { value, place: text.place }),
        Err(error) => {
            reader.report(text.place, error.to_string());
            None
        }
    }
}

fn limits(reader: &mut Reader, node: &Node) -> Option<Limits> {
    let fields = reader.fields("limits", node, &["timeout_secs", "max_joint_speed_fraction", "workspace"])?;
    let mut limits = Limits::default();
    if let Some(node) = fields.get("timeout_secs") {
        limits.timeout_secs = reader.number("timeout_secs", node, 1.0, 3600.0)?;
    }
    if let Some(node) = fields.get("max_joint_speed_fraction") {
        limits.max_joint_speed_fraction = reader.number("max_joint_speed_fraction", node, 0.01, 1.0)?;
    }
    if let Some(node) = fields.get("workspace") {
        let fields = reader.fields("workspace", node, &["x_m", "y_m", "z_m"])?;
        let mut axis = |key: &str| reader.required("workspace", &fields, key).and_then(|node| reader.range(key, node, -3.0, 3.0));
        let (x_m, y_m, z_m) = (axis("x_m"), axis("y_m"), axis("z_m"));
        limits.workspace = Some(Workspace { x_m: x_m?, y_m: y_m?, z_m: z_m? });
    }
    Some(limits)
}
