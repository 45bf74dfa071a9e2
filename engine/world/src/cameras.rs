//! What the cameras see, and pictures from a free viewpoint.

use crate::bodies::{Bodies, GrainBody, ObjectBody};
use crate::judge::Finger;
use crate::robot::{ActingRobot, Place, VisibleLink};
use crate::scene::{TableSpec, WorldSettings};
use crate::{World, WorldError};
use sfg_geometry::{TriMesh, mesh};
use sfg_kinematics::{Camera, RobotModel, Shape};
use sfg_render::{Finish, Item, NO_ID, Picture, RenderMesh, Scene, SensorNoise, Sphere, camera, render, render_smooth};
use sfg_types::{Observation, Point, Pose, RgbdImage, Vector};

/// A free viewpoint for pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// Where the eye is.
    pub eye_in_base: Point,
    /// What it looks at.
    pub target_in_base: Point,
    /// Horizontal field of view, degrees.
    pub horizontal_fov_deg: f64,
    /// Image width, pixels.
    pub width_px: usize,
    /// Image height, pixels.
    pub height_px: usize,
}

impl Default for Viewpoint {
    /// From the right front, a little above: robot, hand and table in one view.
    fn default() -> Self {
        Self {
            eye_in_base: Point::new(1.65, -0.95, 1.45),
            target_in_base: Point::new(0.5, 0.05, 0.85),
            horizontal_fov_deg: 45.0,
            width_px: 1280,
            height_px: 800,
        }
    }
}

/// Colours of the robot: light arms, dark hand, as the real one.
const ARM_COLOUR: [u8; 3] = [214, 214, 210];
const HAND_COLOUR: [u8; 3] = [62, 66, 72];
const FLOOR_COLOUR: [u8; 3] = [128, 132, 136];
const GRAIN_COLOURS: [[u8; 3]; 2] = [[236, 190, 92], [222, 168, 70]];
/// Meridians of the robot's round links.
const N_AROUND: usize = 24;

/// A mesh and what carries it.
struct Shown {
    mesh: RenderMesh,
    finish: Finish,
    place: Place,
}

impl Shown {
    fn plain(mesh: &TriMesh, place: Place) -> Self {
        Self { mesh: RenderMesh::new(mesh), finish: Finish::Plain, place }
    }
}

/// Meshes of everything visible, and the calibrated cameras.
pub struct Cameras {
    cameras: Vec<(Camera, Pose)>,
    shown: Vec<Shown>,
    grain_radius_m: f64,
    noise: Option<SensorNoise>,
    n_exposures: u64,
}

impl Cameras {
    pub(crate) fn new(
        robot: &RobotModel,
        acting: &ActingRobot,
        table: &TableSpec,
        objects: &[ObjectBody],
        settings: &WorldSettings,
    ) -> Self {
        let poses = robot.camera_poses(&robot.home_q);
        let mut shown = vec![floor(), table_slab(table)];
        shown.extend(acting.visible_links(robot).iter().filter_map(link_mesh));
        shown.extend(objects.iter().flat_map(object_meshes));
        Self {
            cameras: robot.cameras.iter().cloned().zip(poses).collect(),
            shown,
            grain_radius_m: settings.grain_radius_m,
            noise: settings.camera_noise.then(SensorNoise::default),
            n_exposures: 0,
        }
    }

    /// Everything where it is now.
    fn scene<'a>(&'a self, bodies: &Bodies) -> Scene<'a> {
        let item = |shown: &'a Shown| Item {
            mesh: &shown.mesh,
            base_from_mesh: match &shown.place {
                Place::Fixed(pose) => *pose,
                Place::OnBody(body, body_from_mesh) => bodies.pose(*body) * body_from_mesh,
            },
            colour: ARM_COLOUR,
            finish: shown.finish,
            instance_id: NO_ID,
            part_id: NO_ID,
        };
        let sphere = |(idx, grain): (usize, &GrainBody)| Sphere {
            centre_in_base: bodies.centre(grain.body),
            radius_m: self.grain_radius_m,
            colour: GRAIN_COLOURS[idx % 2],
            instance_id: NO_ID,
            part_id: NO_ID,
        };
        Scene {
            items: self.shown.iter().map(item).collect(),
            spheres: bodies.grains.iter().enumerate().map(sphere).collect(),
            ..Scene::default()
        }
    }
}

impl World {
    /// Names of the cameras, in the order of the robot description.
    #[must_use]
    pub fn camera_names(&self) -> Vec<String> {
        self.cameras.cameras.iter().map(|(camera, _)| camera.name.clone()).collect()
    }

    /// The newest image of every camera, in the order of the robot description; each exposure has its own noise.
    #[must_use]
    pub fn observe(&mut self) -> Observation {
        let exposure_idx = self.cameras.n_exposures;
        self.cameras.n_exposures += 1;
        let scene = self.cameras.scene(&self.bodies);
        let expose = |(camera_idx, (camera, base_from_camera)): (usize, &(Camera, Pose))| {
            let mut frame = render(&scene, &camera.intrinsics, base_from_camera);
            if let Some(noise) = &self.cameras.noise {
                noise.apply(&mut frame, &camera.intrinsics, self.seed, exposure_idx, camera_idx as u64);
            }
            frame.into_rgbd(&camera.name, &camera.intrinsics, base_from_camera)
        };
        Observation { views: self.cameras.cameras.iter().enumerate().map(expose).collect(), stamp_secs: self.stamp_secs() }
    }

    /// The newest image of one camera.
    ///
    /// # Errors
    /// [`WorldError::UnknownCamera`].
    pub fn render(&mut self, camera: &str) -> Result<RgbdImage, WorldError> {
        let known = self.camera_names();
        let image = self.observe().views.into_iter().find(|view| view.camera == camera);
        image.ok_or_else(|| WorldError::UnknownCamera { name: camera.to_owned(), known })
    }

    /// A picture from a free viewpoint, without sensor noise, marked as one of the simulator.
    #[must_use]
    pub fn picture(&self, viewpoint: &Viewpoint) -> Picture {
        let fov_rad = viewpoint.horizontal_fov_deg.to_radians();
        let intrinsics = camera::intrinsics(viewpoint.width_px, viewpoint.height_px, fov_rad);
        let base_from_camera = camera::look_at(&viewpoint.eye_in_base, &viewpoint.target_in_base);
        let mut picture = Picture::from_frame(&render_smooth(&self.cameras.scene(&self.bodies), &intrinsics, &base_from_camera));
        let mark = format!("simulator, t = {:.2} s", self.stamp_secs());
        picture.label(12, viewpoint.height_px as i64 - 32, 2, [255; 3], [40, 44, 52], &mark);
        picture
    }
}

fn floor() -> Shown {
    let slab = mesh::cuboid(&Vector::new(4.0, 4.0, 0.01)).coloured(FLOOR_COLOUR);
    Shown { finish: Finish::Tiles, ..Shown::plain(&slab, Place::Fixed(Pose::translation(0.0, 0.0, -0.01))) }
}

fn table_slab(table: &TableSpec) -> Shown {
    let ([x0, x1], [y0, y1], thickness) = (table.x_m, table.y_m, table.thickness_m);
    let half = Vector::new((x1 - x0) / 2.0, (y1 - y0) / 2.0, thickness / 2.0);
    let centre = Pose::translation((x0 + x1) / 2.0, (y0 + y1) / 2.0, table.height_m - thickness / 2.0);
    Shown { finish: Finish::Wood, ..Shown::plain(&mesh::cuboid(&half).coloured(table.colour), Place::Fixed(centre)) }
}

fn link_mesh(link: &VisibleLink) -> Option<Shown> {
    let mut whole = TriMesh::default();
    for part in &link.shapes {
        let mesh = match &part.shape {
            Shape::Cuboid { half_extents_m } => mesh::cuboid(half_extents_m),
            Shape::Sphere { radius_m } => mesh::sphere(*radius_m, N_AROUND),
            Shape::Cylinder { radius_m, half_length_m } => mesh::cylinder(*half_length_m, *radius_m, N_AROUND),
            Shape::Capsule { radius_m, half_length_m } => mesh::capsule(*half_length_m, *radius_m, N_AROUND),
            Shape::Mesh { .. } => continue,
        };
        whole.append(&mesh.transformed(&part.link_from_shape));
    }
    let is_hand = Finger::from_name(&link.name).is_some() || link.name.contains("hand");
    let colour = if is_hand { HAND_COLOUR } else { ARM_COLOUR };
    (!whole.triangles.is_empty()).then(|| Shown::plain(&whole.coloured(colour), link.place.clone()))
}

fn object_meshes(object: &ObjectBody) -> Vec<Shown> {
    let place = Place::OnBody(object.body, Pose::identity());
    let shown = |part: sfg_geometry::object::DisplayMesh| {
        Shown::plain(&part.mesh.coloured(object.colour.unwrap_or(part.colour)), place.clone())
    };
    object.instance.display_meshes().into_iter().map(shown).collect()
}
