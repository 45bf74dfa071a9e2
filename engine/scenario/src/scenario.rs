//! A scenario as a whole.

use crate::document::{self, MAX_FILE_BYTES, Node, Value};
use crate::mistake::{At, Mistake, Place, ScenarioErrors, Source};
use crate::plugins::Plugins;
use crate::reader::Reader;
use crate::scene::{Range, Scene};
use crate::success::Success;
use crate::tree::{TreeReader, help_for};
use crate::vocabulary::Vocabulary;
use sfg_tree::{BuildError, Problem, Registry, Tree, TreeSpec};
use sfg_types::{HandSide, Instruction};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;
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
    /// The file.
    pub source: Arc<Source>,
    places: Vec<Place>,
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

const KEYS: [&str; 11] =
    ["version", "robot", "arm", "scene", "instruction", "plugins", "tree", "subtrees", "success", "limits", "description"];

impl Scenario {
    /// The scenario in the file at `path`.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the file, or why it cannot be read.
    pub fn load<C>(path: &Path, registry: &Registry<C>, vocabulary: &Vocabulary) -> Result<Self, ScenarioErrors> {
        let unreadable = |error: std::io::Error| ScenarioErrors::unreadable(path, error.to_string());
        let file = std::fs::File::open(path).map_err(unreadable)?;
        let mut bytes = Vec::new();
        // One byte more than accepted tells a full file from a cut one, also for files that do not know their length.
        file.take(MAX_FILE_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        if bytes.len() > MAX_FILE_BYTES {
            let message =
                format!("it is larger than {} MB; split it, or name files instead of copying them", MAX_FILE_BYTES >> 20);
            return Err(ScenarioErrors::unreadable(path, message));
        }
        let text = String::from_utf8(bytes).map_err(|error| {
            ScenarioErrors::unreadable(path, format!("byte {} is no UTF-8 text", error.utf8_error().valid_up_to()))
        })?;
        Self::parse(path, text, registry, vocabulary)
    }

    /// The scenario in `text`; `path` is shown in messages.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the text.
    pub fn parse<C>(path: &Path, text: String, registry: &Registry<C>, vocabulary: &Vocabulary) -> Result<Self, ScenarioErrors> {
        if text.len() > MAX_FILE_BYTES {
            return Err(ScenarioErrors::unreadable(path, format!("it is larger than {} MB", MAX_FILE_BYTES >> 20)));
        }
        let source = Arc::new(Source { path: path.to_owned(), text });
        let document = match document::parse(&source.text) {
            Ok(document) => document,
            Err(mistake) => return Err(ScenarioErrors::mistakes(source, vec![mistake])),
        };
        let mut reader = Reader::default();
        let scenario = read(&mut reader, &document, &source, registry, vocabulary);
        match scenario {
            Some(scenario) if reader.mistakes.is_empty() => Ok(scenario),
            _ => Err(ScenarioErrors::mistakes(source, reader.mistakes)),
        }
    }

    /// The runnable tree.
    ///
    /// # Errors
    /// The mistakes that `registry` finds; none when the scenario was loaded with the same one.
    pub fn build_tree<C>(&self, registry: &Registry<C>) -> Result<Tree<C>, ScenarioErrors> {
        registry.build(&self.tree).map_err(|errors| {
            let mistakes = errors.into_iter().map(|error| mistake_of(error, &self.places)).collect();
            ScenarioErrors::mistakes(Arc::clone(&self.source), mistakes)
        })
    }

    /// Where a tree node was written; takes the location that the tree's definition gives.
    #[must_use]
    pub fn place(&self, location: u32) -> Option<Place> {
        self.places.get(location as usize).copied()
    }

    /// Mistakes that the application found, shown as those found here.
    #[must_use]
    pub fn errors(&self, mistakes: Vec<Mistake>) -> ScenarioErrors {
        ScenarioErrors::mistakes(Arc::clone(&self.source), mistakes)
    }
}

fn mistake_of(error: BuildError, places: &[Place]) -> Mistake {
    let place = places.get(error.location as usize).copied().unwrap_or(Place::START);
    Mistake { place, message: error.problem.to_string(), help: error.help }
}

fn read<C>(
    reader: &mut Reader,
    document: &Node,
    source: &Arc<Source>,
    registry: &Registry<C>,
    vocabulary: &Vocabulary,
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
    if let Some(version) = reader.required("scenario", &fields, "version")
        && !matches!(version.value, Value::Int(1))
    {
        reader.wrong::<()>("version", version, "1");
    }
    if let Some(description) = fields.get("description") {
        reader.text("description", description);
    }
    let robot = reader.required("scenario", &fields, "robot").and_then(|node| reader.word("robot", node, &vocabulary.robots));
    let arm = fields.get("arm").map_or(Some(HandSide::Left), |node| arm(reader, node));
    let scene = reader.required("scenario", &fields, "scene").and_then(|node| reader.scene(node, vocabulary));
    let instruction = fields.get("instruction").and_then(|node| instruction(reader, node));
    let plugins = fields.get("plugins").map_or_else(|| Some(Plugins::default()), |node| reader.plugins(node, vocabulary));
    let success = fields.get("success").map_or_else(|| Some(Success::default()), |node| reader.success(node, vocabulary));
    let limits = fields.get("limits").map_or_else(|| Some(Limits::default()), |node| limits(reader, node));
    let tree = reader.required("scenario", &fields, "tree");

    let mut reasons = vocabulary.reasons.clone();
    if !reasons.is_empty() {
        reasons.extend(sfg_tree::reason::ALL.iter().map(|reason| (*reason).to_owned()));
    }
    let mut trees = TreeReader { reader, models: registry.models(), reasons, places: Vec::new(), spoilt: BTreeSet::new() };
    // Number 0 is the whole file, for nodes without a place.
    trees.places.push(Place::START);
    let subtrees = fields.get("subtrees").map_or_else(|| Some(Vec::new()), |node| trees.subtrees(node));
    let root = tree.and_then(|node| trees.node(node));
    let (places, spoilt) = (trees.places, trees.spoilt);
    let tree = TreeSpec { root: root?, subtrees: subtrees?, ..TreeSpec::default() };
    if let Err(errors) = registry.build(&tree) {
        let is_unread =
            |error: &BuildError| matches!(error.problem, Problem::UnknownNode { .. } | Problem::UnknownSubtree { .. });
        let has_gaps = !spoilt.is_empty() || errors.iter().any(is_unread);
        // A node that could not be read would have had the port, the child or the key that is now missing.
        let is_consequence = |error: &BuildError| match error.problem {
            Problem::MissingPort { .. } | Problem::ChildCount { .. } => spoilt.contains(&error.location),
            Problem::DanglingKey { .. } => has_gaps && error.help.is_none(),
            _ => false,
        };
        reader.mistakes.extend(errors.into_iter().filter(|error| !is_consequence(error)).map(|mut error| {
            error.help = error.help.or_else(|| help_for(&error.problem, registry.models()));
            mistake_of(error, &places)
        }));
    }
    Some(Scenario {
        robot: robot?,
        arm: arm?,
        scene: scene?,
        instruction,
        plugins: plugins?,
        tree,
        success: success?,
        limits: limits?,
        source: Arc::clone(source),
        places,
    })
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
