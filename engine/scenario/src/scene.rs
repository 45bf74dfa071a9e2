//! `scene`: what stands where, fixed or drawn from ranges.

use crate::document::{Node, Value};
use crate::mistake::At;
use crate::reader::Reader;
use crate::vocabulary::Vocabulary;
use std::f64::consts::PI;
use std::path::PathBuf;

/// A number drawn uniformly from `min` to `max`; fixed when they are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
}

impl Range {
    /// One value.
    #[must_use]
    pub fn fixed(value: f64) -> Self {
        Self { min: value, max: value }
    }

    /// The value for a uniform random number from 0 to 1. A fixed range gives its value exactly.
    #[must_use]
    pub fn at(self, uniform: f64) -> f64 {
        self.min + (self.max - self.min) * uniform
    }
}

/// What the robot finds before it.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Height of the table top above the base origin, metres.
    pub table_height_m: Range,
    /// Friction coefficient of every pair of surfaces that touch, at most 0.8.
    pub friction: Range,
    /// In the order of the file.
    pub objects: Vec<SceneObject>,
    /// Objects that nobody asks for.
    pub distractors: Option<Distractors>,
}

/// One object on the table.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneObject {
    /// How success predicates call it; the robot never sees this name.
    pub name: At<String>,
    /// What it looks like.
    pub shape: ObjectShape,
    /// Where it stands.
    pub placement: Placement,
    /// Grains inside.
    pub filled_grains: u32,
    /// Colour word instead of the model's own.
    pub colour: Option<At<String>>,
    /// Factor on the height.
    pub height_scale: Range,
    /// Factor on the width and depth.
    pub radius_scale: Range,
    /// Factor on the mass.
    pub mass_scale: Range,
}

/// Where the geometry of an object comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectShape {
    /// A declarative model by name.
    Model(At<String>),
    /// A scan; paths are relative to the file that names them.
    Scanned {
        /// Surface, Wavefront OBJ.
        mesh: At<PathBuf>,
        /// Convex parts, Wavefront OBJ with one object each.
        hulls: At<PathBuf>,
        /// Mass, kilograms.
        mass_kg: f64,
        /// How a closed scan is made a vessel; as it is when absent.
        hollow: Option<Hollow>,
    },
}

/// A closed scan is cut off level and bored from there, so that it holds grains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hollow {
    /// Height of the cut over the base, metres.
    pub mouth_m: f64,
    /// Thinnest wall, metres.
    pub wall_m: f64,
}

/// A pose on the table in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Ahead of the robot, metres.
    pub x_m: Range,
    /// To its left, metres.
    pub y_m: Range,
    /// Rotation about the vertical, radians.
    pub yaw_rad: Range,
}

/// Objects drawn at random and put where room is.
#[derive(Clone, Debug, PartialEq)]
pub struct Distractors {
    /// How many.
    pub n: u32,
    /// Models to draw from; any when empty.
    pub from: Vec<At<String>>,
}

/// What any scan may be cut at; the scan itself says the rest.
pub(crate) const MOUTH_M: (f64, f64) = (0.023, 1.0);
/// Thinner walls let grains through.
pub(crate) const WALL_M: (f64, f64) = (0.003, 0.05);
const SCALE: (f64, f64) = (0.2, 5.0);
/// Friction above this is no honest simulation of a hand.
const MAX_FRICTION: f64 = 0.8;
const DEFAULT_FRICTION: f64 = 0.6;
const DEFAULT_TABLE_HEIGHT_M: f64 = 0.75;
/// Beyond this nothing can be reached.
const REACH_M: (f64, f64) = (-3.0, 3.0);

impl Reader {
    pub(crate) fn scene(&mut self, node: &Node, vocabulary: &Vocabulary) -> Option<Scene> {
        let fields = self.fields("scene", node, &["table", "objects", "distractors", "friction"])?;
        let mut table_height_m = Range::fixed(DEFAULT_TABLE_HEIGHT_M);
        if let Some(table) = fields.get("table")
            && let Some(table) = self.fields("table", table, &["height_m"])
        {
            table_height_m = self.range_or(&table, "height_m", (0.2, 1.5), table_height_m);
        }
        let friction = self.range_or(&fields, "friction", (0.05, MAX_FRICTION), Range::fixed(DEFAULT_FRICTION));
        let mut objects: Vec<SceneObject> = Vec::new();
        if let Some(list) = self.required("scene", &fields, "objects") {
            for item in self.list("objects", list)? {
                if let Some(object) = self.object(item, vocabulary) {
                    if objects.iter().any(|earlier| earlier.name.value == object.name.value) {
                        self.report_with_help(
                            object.name.place,
                            format!("two objects are called {:?}", object.name.value),
                            "give each a name of its own and say the model apart: `- mug_2: {model: mug}`",
                        );
                    }
                    objects.push(object);
                }
            }
        }
        let distractors = fields.get("distractors").and_then(|node| self.distractors(node, vocabulary));
        Some(Scene { table_height_m, friction, objects, distractors })
    }

    fn object(&mut self, item: &Node, vocabulary: &Vocabulary) -> Option<SceneObject> {
        let expected = "a name and what it is, such as `- cup: {model: mug, at: {x_m: 0.6, y_m: 0.1}}`";
        let help = "begin it with `- `, or indent it to make it a key of the object";
        let (key, body) = self.only("object", item, expected, help)?;
        const KEYS: &[&str] = &[
            "model",
            "mesh",
            "hulls",
            "mass_kg",
            "hollow",
            "at",
            "filled_grains",
            "colour",
            "height_scale",
            "radius_scale",
            "mass_scale",
        ];
        let what = format!("object {:?}", key.text);
        let fields = self.fields(&what, body, KEYS)?;
        let shape = match (fields.get("model"), fields.get("mesh")) {
            (Some(model), None) => {
                for scanned_key in ["hulls", "mass_kg", "hollow"] {
                    if let Some(place) = fields.key_place(scanned_key) {
                        self.report(place, format!("{what}: {scanned_key:?} belongs to `mesh`, not to `model`"));
                    }
                }
                self.word("object model", model, &vocabulary.object_models).map(ObjectShape::Model)
            }
            (None, Some(mesh)) => {
                let mesh = self.path("mesh", mesh);
                let hulls = self.required(&what, &fields, "hulls").and_then(|node| self.path("hulls", node));
                let mass_kg = self.required(&what, &fields, "mass_kg").and_then(|node| self.number("mass_kg", node, 0.001, 10.0));
                let hollow = fields.get("hollow").map_or(Some(None), |node| self.hollow(node).map(Some));
                let (mesh, hulls, mass_kg, hollow) = (mesh?, hulls?, mass_kg?, hollow?);
                Some(ObjectShape::Scanned { mesh, hulls, mass_kg, hollow })
            }
            (Some(_), Some(mesh)) => {
                self.report(mesh.place, format!("{what} has both `model` and `mesh`"));
                None
            }
            (None, None) => {
                self.report_with_help(
                    key.place,
                    format!("{what} needs key \"model\""),
                    "or `mesh`, `hulls` and `mass_kg` for a scan",
                );
                None
            }
        };
        let placement = self.required(&what, &fields, "at").and_then(|node| self.placement(node));
        let filled_grains = fields.get("filled_grains").map_or(Some(0), |node| self.count("filled_grains", node, 0, 2000));
        let colour = fields.get("colour").map(|node| self.text("colour", node));
        let one = Range::fixed(1.0);
        let height_scale = self.range_or(&fields, "height_scale", SCALE, one);
        let radius_scale = self.range_or(&fields, "radius_scale", SCALE, one);
        let mass_scale = self.range_or(&fields, "mass_scale", SCALE, one);
        let name = At { value: key.text.clone(), place: key.place };
        let (shape, placement, filled_grains, colour) = (shape?, placement?, filled_grains?, colour.flatten());
        Some(SceneObject { name, shape, placement, filled_grains, colour, height_scale, radius_scale, mass_scale })
    }

    fn hollow(&mut self, node: &Node) -> Option<Hollow> {
        let fields = self.fields("hollow", node, &["mouth_m", "wall_m"])?;
        let mouth_m =
            self.required("hollow", &fields, "mouth_m").and_then(|node| self.number("mouth_m", node, MOUTH_M.0, MOUTH_M.1));
        let wall_m = self.required("hollow", &fields, "wall_m").and_then(|node| self.number("wall_m", node, WALL_M.0, WALL_M.1));
        Some(Hollow { mouth_m: mouth_m?, wall_m: wall_m? })
    }

    fn path(&mut self, what: &str, node: &Node) -> Option<At<PathBuf>> {
        self.text(what, node).map(|text| At { value: PathBuf::from(&text.value), place: text.place })
    }

    fn placement(&mut self, node: &Node) -> Option<Placement> {
        let fields = self.fields("at", node, &["x_m", "y_m", "yaw_rad"])?;
        let x_m = self.required("at", &fields, "x_m").and_then(|node| self.range("x_m", node, REACH_M.0, REACH_M.1));
        let y_m = self.required("at", &fields, "y_m").and_then(|node| self.range("y_m", node, REACH_M.0, REACH_M.1));
        let yaw_rad = match fields.angle("yaw_rad") {
            None => Some(Range::fixed(0.0)),
            Some(angle) => match &angle.node.value {
                Value::Text(word) if word == "any" => Some(Range { min: -PI, max: PI }),
                Value::Text(_) => self.wrong(angle.key, angle.node, &format!("{}, [min, max] or any", angle.unit())),
                _ => {
                    let turn = angle.full_turn();
                    self.range(angle.key, angle.node, -turn, turn).map(|range| angle.to_radians(range))
                }
            },
        };
        Some(Placement { x_m: x_m?, y_m: y_m?, yaw_rad: yaw_rad? })
    }

    fn distractors(&mut self, node: &Node, vocabulary: &Vocabulary) -> Option<Distractors> {
        let fields = self.fields("distractors", node, &["n", "from"])?;
        let n = self.required("distractors", &fields, "n").and_then(|node| self.count("n", node, 0, 20))?;
        let from = match fields.get("from") {
            Some(list) => self.list("from", list)?,
            None => &[],
        };
        let from = from.iter().filter_map(|word| self.word("object model", word, &vocabulary.object_models)).collect();
        Some(Distractors { n, from })
    }
}
