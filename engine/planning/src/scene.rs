//! What stands about the robot and what it holds: the one description from which collision models are made.

use crate::collision::{BodyGroup, CollisionModel};
use crate::occupancy::Occupancy;
use crate::shapes::{Obstacle, covering_spheres};
use serde::{Deserialize, Serialize};
use sfg_kinematics::{Primitive, Shape};
use sfg_types::{Point, Pose};
use std::collections::{BTreeMap, BTreeSet};

/// Things, held things, permissions and what cameras have seen.
///
/// A plain value: cloned, changed and compared freely; [`Self::apply`] makes a collision model of the robot follow it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanningScene {
    things: BTreeMap<String, Obstacle>,
    held: BTreeMap<String, Held>,
    allowed: BTreeSet<(BodyGroup, String)>,
    /// What cameras have seen beside the things; empty by default.
    #[serde(skip)]
    pub occupancy: Option<Occupancy>,
    /// Whether space that no camera has seen counts as occupied.
    pub unobserved_blocks: bool,
}

/// Something in the hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Held {
    /// Its mass, kg, for torque limits.
    pub mass_kg: f64,
    /// Balls that cover it, palm frame, metres.
    pub spheres_in_palm: Vec<(Point, f64)>,
    /// What it is when it is put down; none when it was only known by balls.
    pub thing: Option<(Shape, Pose)>,
}

/// Why the scene was not changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A name that is not there.
    #[error("the planning scene has no {what} called {name:?}; it has {known}")]
    Unknown {
        /// `thing` or `held thing`.
        what: &'static str,
        /// The name asked for.
        name: String,
        /// Those that are there.
        known: String,
    },
    /// A name twice.
    #[error("the planning scene has {name:?} already; remove it first or choose another name")]
    Taken {
        /// The name.
        name: String,
    },
    /// A size, place or mass that cannot be.
    #[error("{name:?}: {message}")]
    Bad {
        /// Whose.
        name: String,
        /// What was found and what was expected.
        message: String,
    },
    /// A dump that cannot be read.
    #[error("the planning scene cannot be read: {0}")]
    Unreadable(String),
}

/// Balls of held things stand out by this much at most.
const HELD_EXCESS_M: f64 = 0.004;
/// What cameras see this near to a thing is that thing.
const KNOWN_MARGIN_M: f64 = 0.02;

impl PlanningScene {
    /// A scene of things.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn of(things: impl IntoIterator<Item = Obstacle>) -> Result<Self, SceneError> {
        let mut scene = Self::default();
        things.into_iter().try_for_each(|thing| scene.add(thing))?;
        Ok(scene)
    }

    /// Adds a thing that must not be touched.
    ///
    /// # Errors
    /// [`SceneError::Taken`]; [`SceneError::Bad`] for a mesh, a size that is not positive or a pose that is not finite.
    pub fn add(&mut self, thing: Obstacle) -> Result<(), SceneError> {
        if self.things.contains_key(&thing.name) || self.held.contains_key(&thing.name) {
            return Err(SceneError::Taken { name: thing.name });
        }
        check(&thing)?;
        self.things.insert(thing.name.clone(), thing);
        Ok(())
    }

    /// Takes a thing out.
    ///
    /// # Errors
    /// [`SceneError::Unknown`].
    pub fn remove(&mut self, name: &str) -> Result<Obstacle, SceneError> {
        self.things.remove(name).ok_or_else(|| unknown("thing", name, self.things.keys()))
    }

    /// Things that are not held.
    pub fn things(&self) -> impl Iterator<Item = &Obstacle> {
        self.things.values()
    }

    /// What is held, by name.
    pub fn held(&self) -> impl Iterator<Item = (&str, &Held)> {
        self.held.iter().map(|(name, held)| (name.as_str(), held))
    }

    /// Mass of all that is held, kg.
    #[must_use]
    pub fn payload_kg(&self) -> f64 {
        self.held.values().map(|held| held.mass_kg).sum()
    }

    /// Hangs a thing of the scene on the palm, which is at `base_from_palm`.
    ///
    /// # Errors
    /// [`SceneError::Unknown`]; [`SceneError::Bad`] for a mass that is negative or not finite.
    pub fn attach(&mut self, name: &str, base_from_palm: &Pose, mass_kg: f64) -> Result<(), SceneError> {
        check_mass(name, mass_kg)?;
        let Obstacle { name, shape, pose_in_base } = self.remove(name)?;
        let palm_from_thing = base_from_palm.inverse() * pose_in_base;
        let primitive = Primitive { shape: shape.clone(), link_from_shape: palm_from_thing };
        let spheres_in_palm = covering_spheres(&primitive, HELD_EXCESS_M);
        self.held.insert(name, Held { mass_kg, spheres_in_palm, thing: Some((shape, palm_from_thing)) });
        Ok(())
    }

    /// Hangs something on the palm that is known by balls alone, palm frame, metres.
    ///
    /// # Errors
    /// [`SceneError::Taken`]; [`SceneError::Bad`] for a mass or a ball that cannot be.
    pub fn attach_spheres(&mut self, name: &str, spheres_in_palm: Vec<(Point, f64)>, mass_kg: f64) -> Result<(), SceneError> {
        check_mass(name, mass_kg)?;
        if self.things.contains_key(name) || self.held.contains_key(name) {
            return Err(SceneError::Taken { name: name.to_owned() });
        }
        check_spheres(name, &spheres_in_palm)?;
        self.held.insert(name.to_owned(), Held { mass_kg, spheres_in_palm, thing: None });
        Ok(())
    }

    /// Lets go of something held; it stands where the palm had it, if its shape is known.
    ///
    /// # Errors
    /// [`SceneError::Unknown`].
    pub fn detach(&mut self, name: &str, base_from_palm: &Pose) -> Result<(), SceneError> {
        let held = self.held.remove(name).ok_or_else(|| unknown("held thing", name, self.held.keys()))?;
        if let Some((shape, palm_from_thing)) = held.thing {
            let thing = Obstacle { name: name.to_owned(), shape, pose_in_base: base_from_palm * palm_from_thing };
            self.things.insert(name.to_owned(), thing);
        }
        Ok(())
    }

    /// Lets a part of the robot touch a thing (`points` stands for what cameras have seen).
    pub fn allow(&mut self, group: BodyGroup, with: &str) {
        self.allowed.insert((group, with.to_owned()));
    }

    /// Takes a permission back.
    pub fn forbid(&mut self, group: BodyGroup, with: &str) {
        self.allowed.remove(&(group, with.to_owned()));
    }

    /// Makes the collision model of a robot follow this scene.
    pub fn apply(&self, model: &mut CollisionModel) {
        model.clear_allowed();
        model.detach();
        for (name, held) in &self.held {
            model.attach(name, &held.spheres_in_palm);
        }
        for (group, with) in &self.allowed {
            model.allow(*group, with);
        }
        let is_known = |point: &Point| {
            self.things.values().any(|thing| {
                let local = thing.pose_in_base.inverse() * point;
                crate::shapes::signed_distance_m(&thing.shape, &local) < KNOWN_MARGIN_M
            })
        };
        let seen = self.occupancy.as_ref().map(|seen| seen.obstacles(self.unobserved_blocks, is_known));
        let things: Vec<Obstacle> = self.things.values().cloned().collect();
        model.set_world(&things, seen.filter(|points| !points.is_empty()));
    }

    /// The scene as JSON; what cameras have seen is left out.
    ///
    /// # Errors
    /// [`SceneError::Unreadable`] for numbers that JSON has no form for.
    pub fn dump(&self) -> Result<String, SceneError> {
        let dump = Dump { version: DUMP_VERSION, scene: Self { occupancy: None, ..self.clone() } };
        serde_json::to_string_pretty(&dump).map_err(|error| SceneError::Unreadable(error.to_string()))
    }

    /// Reads what [`Self::dump`] wrote.
    ///
    /// # Errors
    /// [`SceneError::Unreadable`] with line and column, [`SceneError::Bad`] for things that cannot be.
    pub fn load(text: &str) -> Result<Self, SceneError> {
        let Dump { version, scene } = serde_json::from_str(text).map_err(|error| SceneError::Unreadable(error.to_string()))?;
        if version != DUMP_VERSION {
            return Err(SceneError::Unreadable(format!("version {version}; this program reads version {DUMP_VERSION}")));
        }
        for (name, thing) in &scene.things {
            check(thing)?;
            if *name != thing.name {
                let message = format!("is called {:?} inside; expected the same name", thing.name);
                return Err(SceneError::Bad { name: name.clone(), message });
            }
        }
        for (name, held) in &scene.held {
            check_mass(name, held.mass_kg)?;
            check_spheres(name, &held.spheres_in_palm)?;
            if scene.things.contains_key(name) {
                return Err(SceneError::Taken { name: name.clone() });
            }
        }
        Ok(scene)
    }
}

/// A scene in a file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Dump {
    version: u32,
    scene: PlanningScene,
}

const DUMP_VERSION: u32 = 1;

fn unknown<'a>(what: &'static str, name: &str, known: impl Iterator<Item = &'a String>) -> SceneError {
    let known: Vec<&str> = known.map(String::as_str).collect();
    let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    SceneError::Unknown { what, name: name.to_owned(), known }
}

fn check(thing: &Obstacle) -> Result<(), SceneError> {
    let bad = |message: String| Err(SceneError::Bad { name: thing.name.clone(), message });
    let sizes: Vec<f64> = match &thing.shape {
        Shape::Cuboid { half_extents_m } => half_extents_m.iter().copied().collect(),
        Shape::Sphere { radius_m } => vec![*radius_m],
        Shape::Cylinder { radius_m, half_length_m } | Shape::Capsule { radius_m, half_length_m } => {
            vec![*radius_m, *half_length_m]
        }
        Shape::Mesh { file, .. } => return bad(format!("mesh {file:?}; expected a box, ball, cylinder or capsule")),
    };
    if !sizes.iter().all(|size| size.is_finite() && *size > 0.0) {
        return bad(format!("sizes {sizes:?} m; expected positive numbers"));
    }
    let (t, r) = (thing.pose_in_base.translation.vector, thing.pose_in_base.rotation.coords);
    if !t.iter().all(|v| v.is_finite()) || (r.norm() - 1.0).abs() > 1e-6 {
        return bad(format!("its pose is {t} with the rotation {r}; expected finite numbers and a unit quaternion"));
    }
    Ok(())
}

fn check_spheres(name: &str, spheres: &[(Point, f64)]) -> Result<(), SceneError> {
    let is_ball =
        |(centre, radius_m): &&(Point, f64)| *radius_m > 0.0 && radius_m.is_finite() && centre.iter().all(|v| v.is_finite());
    match spheres.iter().find(|ball| !is_ball(ball)) {
        None => Ok(()),
        Some((centre, radius_m)) => {
            let message = format!("a ball of radius {radius_m} m at {centre}; expected a positive radius and a finite place");
            Err(SceneError::Bad { name: name.to_owned(), message })
        }
    }
}

fn check_mass(name: &str, mass_kg: f64) -> Result<(), SceneError> {
    if mass_kg >= 0.0 && mass_kg.is_finite() {
        return Ok(());
    }
    let message = format!("a mass of {mass_kg} kg; expected 0 or more");
    Err(SceneError::Bad { name: name.to_owned(), message })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::collision::{BodySphere, CollisionSettings};
    use crate::occupancy::Voxel;
    use sfg_kinematics::RobotModel;
    use sfg_types::{CameraIntrinsics, HandSide, RgbdImage, Vector};
    use std::path::Path;

    fn thing(name: &str, shape: Shape, xyz: [f64; 3]) -> Obstacle {
        let [x, y, z] = xyz;
        Obstacle { name: name.to_owned(), shape, pose_in_base: Pose::translation(x, y, z) }
    }

    fn table_and_can() -> PlanningScene {
        let table = Shape::Cuboid { half_extents_m: Vector::new(0.35, 0.7, 0.02) };
        let can = Shape::Cylinder { radius_m: 0.04, half_length_m: 0.1 };
        PlanningScene::of([thing("table", table, [0.8, 0.0, 0.73]), thing("can", can, [0.7, 0.3, 0.85])]).unwrap()
    }

    fn model() -> (RobotModel, CollisionModel) {
        let robot = RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap();
        let model = CollisionModel::new(&robot, HandSide::Left, &robot.home_q, CollisionSettings::default()).unwrap();
        (robot, model)
    }

    #[test]
    fn a_held_thing_moves_with_the_palm_and_stands_where_it_is_let_go() {
        let (robot, mut model) = model();
        let home = robot.left.home_q.clone();
        let palm = robot.left.chain.fk(&home);
        let mut scene = table_and_can();
        let in_hand = thing("cup", Shape::Sphere { radius_m: 0.03 }, (palm * Point::new(0.0, 0.0, 0.1)).coords.into());
        scene.add(in_hand.clone()).unwrap();
        scene.attach("cup", &palm, 0.4).unwrap();
        assert_eq!((scene.payload_kg(), scene.things().count(), scene.held().count()), (0.4, 2, 1));
        scene.apply(&mut model);
        let n_with = model.spheres(&home).len();
        let moved = Pose::translation(0.0, 0.1, 0.0) * palm;
        scene.detach("cup", &moved).unwrap();
        scene.apply(&mut model);
        assert_eq!(model.spheres(&home).len() + 1, n_with);
        let cup = scene.things().find(|thing| thing.name == "cup").unwrap();
        let way = cup.pose_in_base.translation.vector - in_hand.pose_in_base.translation.vector;
        assert!((way - Vector::new(0.0, 0.1, 0.0)).norm() < 1e-12);
        assert_eq!(scene.payload_kg(), 0.0);
    }

    #[test]
    fn a_scene_that_is_written_and_read_is_the_same() {
        let mut scene = table_and_can();
        scene.attach("can", &Pose::translation(0.6, 0.2, 0.9), 0.25).unwrap();
        scene.allow(BodyGroup::Hand, "table");
        scene.unobserved_blocks = true;
        let text = scene.dump().unwrap();
        assert_eq!(PlanningScene::load(&text).unwrap(), scene);
        let broken = |from: &str, to: &str| PlanningScene::load(&text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(broken("\"version\": 1", "\"version\": 2").contains("this program reads version 1"));
        assert!(broken("\"scene\"", "\"scenes\"").contains("line"), "{}", broken("\"scene\"", "\"scenes\""));
        assert!(broken("0.25", "-0.25").contains("expected 0 or more"));
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let mut scene = table_and_can();
        let ball = |radius_m| thing("ball", Shape::Sphere { radius_m }, [0.0; 3]);
        assert!(scene.add(ball(-0.1)).unwrap_err().to_string().contains("\"ball\": sizes [-0.1] m"));
        assert!(scene.add(thing("ball", Shape::Sphere { radius_m: 0.1 }, [f64::NAN, 0.0, 0.0])).is_err());
        assert!(
            scene
                .add(thing("mug", Shape::Mesh { file: "mug.stl".to_owned(), scale: Vector::repeat(1.0) }, [0.0; 3]))
                .unwrap_err()
                .to_string()
                .contains("mug.stl")
        );
        assert_eq!(
            scene.add(thing("can", Shape::Sphere { radius_m: 0.1 }, [0.0; 3])),
            Err(SceneError::Taken { name: "can".to_owned() })
        );
        let missing = scene.remove("cap").unwrap_err().to_string();
        assert_eq!(missing, "the planning scene has no thing called \"cap\"; it has can, table");
        assert!(scene.attach("can", &Pose::identity(), f64::NAN).is_err() && scene.things().count() == 2, "nothing is lost");
        assert!(scene.detach("can", &Pose::identity()).unwrap_err().to_string().ends_with("it has none"));
    }

    /// A camera 1 m above the middle of the box looks straight down on a floor at z = 0 and a block of 0.2 m on it.
    fn view() -> RgbdImage {
        let intrinsics = CameraIntrinsics { width: 100, height: 100, fx: 100.0, fy: 100.0, cx: 49.5, cy: 49.5 };
        let looking_down = nalgebra::UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI);
        let base_from_camera = Pose::from_parts(nalgebra::Translation3::new(0.0, 0.0, 1.0), looking_down);
        let depth_m = (0..10_000)
            .map(|idx| {
                let (x, y) = (f64::from(idx % 100) - 49.5, f64::from(idx / 100) - 49.5);
                // The block's top is a square of 0.2 m at a depth of 0.8 m.
                if x.abs() < 12.5 && y.abs() < 12.5 { 0.8 } else { 1.0 }
            })
            .collect();
        RgbdImage { camera: "top".to_owned(), intrinsics, base_from_camera, rgb: vec![0; 30_000], depth_m }
    }

    #[test]
    fn what_a_camera_sees_is_free_occupied_or_unobserved_and_the_robot_is_no_obstacle() {
        let mut seen = Occupancy::new(Point::new(-0.3, -0.3, -0.01), Point::new(0.3, 0.3, 0.5), 0.02).unwrap();
        let at = |seen: &Occupancy, x, y, z| seen.at(&Point::new(x, y, z)).unwrap();
        assert_eq!(at(&seen, 0.0, 0.0, 0.4), Voxel::Unobserved);
        seen.update(&view(), &[]);
        assert_eq!(at(&seen, 0.0, 0.0, 0.4), Voxel::Free);
        assert_eq!(at(&seen, 0.0, 0.0, 0.2), Voxel::Occupied);
        assert_eq!(at(&seen, 0.0, 0.0, 0.1), Voxel::Unobserved, "inside the block");
        assert_eq!(at(&seen, 0.25, 0.2, 0.0), Voxel::Occupied, "the floor");
        assert_eq!(seen.at(&Point::new(0.0, 0.0, 0.6)), None);
        let n_unobserved = seen.count(Voxel::Unobserved);
        assert!(n_unobserved > 0 && n_unobserved < seen.count(Voxel::Free));
        assert_eq!(seen.obstacles(true, |_| false).len(), seen.obstacles(false, |_| false).len() + n_unobserved);
        // The block is the robot's own hand.
        let hand = BodySphere { centre_in_base: Point::new(0.0, 0.0, 0.2), radius_m: 0.2 };
        seen.update(&view(), &[hand]);
        assert_eq!(at(&seen, 0.0, 0.0, 0.2), Voxel::Free);
        // It goes away, then comes back: what was seen last counts.
        let mut empty = view();
        empty.depth_m.fill(1.0);
        seen.update(&empty, &[]);
        assert_eq!(at(&seen, 0.0, 0.0, 0.1), Voxel::Free);
        empty.depth_m.fill(0.0);
        seen.update(&empty, &[]);
        assert_eq!(at(&seen, 0.0, 0.0, 0.1), Voxel::Free, "no return tells nothing");
        assert!(Occupancy::new(Point::origin(), Point::new(1.0, 1.0, f64::NAN), 0.02).is_none());
        assert!(Occupancy::new(Point::origin(), Point::new(10.0, 10.0, 10.0), 0.01).is_none());
    }

    #[test]
    fn space_that_was_not_seen_blocks_an_approach_and_known_things_are_not_seen_twice() {
        let (robot, mut model) = model();
        let home = robot.left.home_q.clone();
        let palm = robot.left.chain.fk(&home).translation.vector;
        let half = Vector::from_element(0.1);
        let mut scene = PlanningScene {
            occupancy: Occupancy::new((palm - half).into(), (palm + half).into(), 0.02),
            ..PlanningScene::default()
        };
        scene.apply(&mut model);
        assert!(model.is_free(&home), "what was not seen is free by default");
        scene.unobserved_blocks = true;
        scene.apply(&mut model);
        assert_eq!(model.contact(&home).unwrap().with, "points");
        scene.allow(BodyGroup::Hand, "points");
        scene.allow(BodyGroup::Arm, "points");
        scene.apply(&mut model);
        assert!(model.is_free(&home));
        // Named things that fill the box leave nothing unobserved about them.
        scene.forbid(BodyGroup::Hand, "points");
        scene.forbid(BodyGroup::Arm, "points");
        scene.add(thing("box", Shape::Cuboid { half_extents_m: half * 1.2 }, palm.into())).unwrap();
        scene.apply(&mut model);
        assert_eq!(model.contact(&home).unwrap().with, "box");
    }
}
