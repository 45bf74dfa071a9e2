//! `sfg robot spheres`: balls that cover a robot's collision shapes, written as a URDF.

use crate::check::BadInput;
use crate::say::say;
use anyhow::{Context as _, Result};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sfg_kinematics::{Link, Shape, Tree};
use sfg_planning::{CoverQuality, Surface, cover_quality, fit_spheres};
use sfg_types::Point;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Options {
    /// The robot's URDF.
    urdf: PathBuf,
    /// How far balls may stand out of a shape, metres.
    #[arg(long, default_value_t = 0.02, conflicts_with = "count")]
    excess_m: f64,
    /// At most so many balls in all; how far they stand out follows.
    #[arg(long, value_name = "N")]
    count: Option<usize>,
    /// Where packages lie, for mesh paths that begin with package://NAME; may be given several times.
    #[arg(long = "package", value_name = "NAME=FOLDER")]
    packages: Vec<String>,
    /// Measures the balls of this URDF against the same shapes, link by link.
    #[arg(long, value_name = "URDF")]
    compare: Option<PathBuf>,
    /// Writes the URDF with balls to this file.
    #[arg(long, value_name = "OUT")]
    out: Option<PathBuf>,
}

/// A link with collision shapes.
struct Body {
    link: String,
    surfaces: Vec<Surface>,
}

type Balls = Vec<(Point, f64)>;

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    if options.count.is_none() && !(1e-4..=1.0).contains(&options.excess_m) {
        return Err(BadInput(format!("--excess-m {}: expected 0.0001 to 1 m", options.excess_m)).into());
    }
    let tree = Tree::load(&options.urdf).map_err(|error| BadInput(error.to_string()))?;
    let with_shapes = || tree.links.iter().filter(|link| !link.collision.is_empty());
    let bodies: Vec<Body> = with_shapes().map(|link| body(link, options)).collect::<Result<_>>()?;
    if bodies.is_empty() {
        return Err(BadInput(format!("{}: no link has a collision shape to cover", options.urdf.display())).into());
    }
    let (excess_m, balls) = match options.count {
        None => (options.excess_m, fit(&bodies, options.excess_m)),
        Some(count) => fit_count(&bodies, count)?,
    };
    let qualities = measure(&bodies, &balls);
    say!("balls stand out by {:.1} mm at most; measured at points {:.0} mm apart", 1e3 * excess_m, 1e3 * SPACING_M);
    table(&bodies, &balls, &qualities);
    if let Some(path) = &options.compare {
        let other = Tree::load(path).map_err(|error| BadInput(error.to_string()))?;
        say!("");
        say!("{}:", path.display());
        let theirs = bodies.iter().map(|body| balls_of(&other, &body.link, path)).collect::<Result<Vec<_>>>()?;
        table(&bodies, &theirs, &measure(&bodies, &theirs));
    }
    let text = std::fs::read_to_string(&options.urdf).with_context(|| format!("cannot read {}", options.urdf.display()))?;
    let covered = with_balls(&text, &bodies, &balls).map_err(|what| BadInput(format!("{}: {what}", options.urdf.display())))?;
    let pairs = touching_pairs(&tree, &bodies, &balls)?;
    say!("");
    say!("{} pairs of links touch in all of {N_SAMPLES} random configurations; an SRDF should disable them:", pairs.len());
    for (a, b) in &pairs {
        say!("<disable_collisions link1=\"{a}\" link2=\"{b}\" reason=\"Default\"/>");
    }
    if let Some(out) = &options.out {
        std::fs::write(out, covered).with_context(|| format!("cannot write {}", out.display()))?;
        let back = Tree::load(out)?;
        let n_balls: usize = back.links.iter().map(|link| link.collision.len()).sum();
        anyhow::ensure!(n_balls == balls.iter().map(Vec::len).sum::<usize>(), "{} does not read back", out.display());
        say!("{n_balls} balls written to {}", out.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Distance of the points that coverage is measured at.
const SPACING_M: f64 = 0.003;
/// Configurations in which pairs are looked at.
const N_SAMPLES: usize = 300;

fn body(link: &Link, options: &Options) -> Result<Body> {
    let mut surfaces = Vec::new();
    for part in &link.collision {
        surfaces.push(match &part.shape {
            Shape::Mesh { file, scale } => {
                let path = mesh_path(file, options).map_err(|what| BadInput(format!("link {:?}: {what}", link.name)))?;
                let wrong = |what: String| BadInput(format!("link {:?}: mesh {}: {what}", link.name, path.display()));
                let scene = mesh_loader::Loader::default().load(&path).map_err(|error| wrong(error.to_string()))?;
                let corner = |p: &[f32; 3]| {
                    let p = sfg_types::Vector::new(p[0].into(), p[1].into(), p[2].into());
                    part.link_from_shape * Point::from(p.component_mul(scale))
                };
                let mut triangles = Vec::new();
                for mesh in &scene.meshes {
                    let at = |idx: u32| mesh.vertices.get(idx as usize).map(corner);
                    for [a, b, c] in &mesh.faces {
                        let found = (|| Some([at(*a)?, at(*b)?, at(*c)?]))();
                        let triangle = found.filter(|t| t.iter().all(|p| p.coords.iter().all(|v| v.is_finite())));
                        triangles.push(triangle.ok_or_else(|| wrong("a triangle has a corner that is no point".to_owned()))?);
                    }
                }
                Surface::mesh(triangles).ok_or_else(|| wrong("there is no triangle with an area".to_owned()))?
            }
            _ => Surface::Primitive(part.clone()),
        });
    }
    Ok(Body { link: link.name.clone(), surfaces })
}

/// The file that a URDF's mesh name means.
fn mesh_path(file: &str, options: &Options) -> Result<PathBuf, String> {
    let folder = options.urdf.parent().unwrap_or(Path::new(""));
    let path = if let Some(inside) = file.strip_prefix("package://") {
        let (name, rest) = inside.split_once('/').ok_or_else(|| format!("mesh {file:?} names no file in its package"))?;
        let given = options.packages.iter().filter_map(|one| one.split_once('=')).find(|(known, _)| *known == name);
        match given {
            Some((_, folder)) => Path::new(folder).join(rest),
            // A package's URDF mostly lies somewhere in the package itself, or in one beside it.
            None => std::path::absolute(folder)
                .ok()
                .and_then(|from| {
                    from.ancestors()
                        .map(|above| if above.ends_with(name) { above.to_owned() } else { above.join(name) })
                        .map(|package| package.join(rest))
                        .find(|path| path.is_file())
                })
                .ok_or_else(|| {
                    format!("mesh {file:?}: package {name:?} is not above or beside the URDF; give --package {name}=FOLDER")
                })?,
        }
    } else {
        folder.join(file.strip_prefix("file://").unwrap_or(file))
    };
    if path.is_file() { Ok(path) } else { Err(format!("mesh {file:?}: there is no file {}", path.display())) }
}

fn fit(bodies: &[Body], excess_m: f64) -> Vec<Balls> {
    bodies.par_iter().map(|body| fit_spheres(&body.surfaces, excess_m)).collect()
}

/// The tightest cover with at most `count` balls, by halving the range of the excess.
fn fit_count(bodies: &[Body], count: usize) -> Result<(f64, Vec<Balls>)> {
    let n_balls = |balls: &[Balls]| balls.iter().map(Vec::len).sum::<usize>();
    let (mut low, mut high) = (0.002_f64, 0.3_f64);
    let mut best = (high, fit(bodies, high));
    if n_balls(&best.1) > count {
        let least = n_balls(&best.1);
        return Err(BadInput(format!("--count {count}: {} links with shapes take at least {least} balls", bodies.len())).into());
    }
    while high / low > 1.03 {
        let middle = (low * high).sqrt();
        let balls = fit(bodies, middle);
        if n_balls(&balls) <= count {
            high = middle;
            best = (middle, balls);
        } else {
            low = middle;
        }
    }
    Ok(best)
}

fn measure(bodies: &[Body], balls: &[Balls]) -> Vec<CoverQuality> {
    bodies.par_iter().zip(balls).map(|(body, balls)| cover_quality(&body.surfaces, balls, SPACING_M)).collect()
}

/// The balls of a link of another model of the same robot.
fn balls_of(tree: &Tree, link: &str, path: &Path) -> Result<Balls> {
    let Ok(idx) = tree.link_idx(link) else { return Ok(Vec::new()) };
    let ball = |part: &sfg_kinematics::Primitive| match part.shape {
        Shape::Sphere { radius_m } => Ok((Point::from(part.link_from_shape.translation.vector), radius_m)),
        _ => Err(BadInput(format!("{}: link {link:?} has collision shapes that are no spheres", path.display())).into()),
    };
    tree.links[idx].collision.iter().map(ball).collect()
}

fn table(bodies: &[Body], balls: &[Balls], qualities: &[CoverQuality]) {
    say!("{:<32} {:>5} {:>9} {:>9} {:>10} {:>10}", "link", "balls", "covered", "bare mm", "mean mm", "worst mm");
    let row = |name: &str, n: usize, q: &CoverQuality| {
        let share = 100.0 * q.n_covered as f64 / q.n_points.max(1) as f64;
        say!(
            "{name:<32} {n:>5} {share:>7.2} % {:>9.1} {:>10.1} {:>10.1}",
            1e3 * if q.bare_m.is_finite() { q.bare_m } else { f64::NAN },
            1e3 * q.mean_excess_m,
            1e3 * q.worst_excess_m
        );
    };
    for ((body, balls), quality) in bodies.iter().zip(balls).zip(qualities) {
        row(&body.link, balls.len(), quality);
    }
    let all: usize = balls.iter().map(Vec::len).sum();
    let sum = |of: fn(&CoverQuality) -> f64| qualities.iter().map(of).sum::<f64>();
    let most = |of: fn(&CoverQuality) -> f64| qualities.iter().map(of).fold(0.0, f64::max);
    let whole = CoverQuality {
        n_points: qualities.iter().map(|q| q.n_points).sum(),
        n_covered: qualities.iter().map(|q| q.n_covered).sum(),
        bare_m: most(|q| q.bare_m),
        // Links count by their surface.
        mean_excess_m: sum(|q| q.mean_excess_m * q.n_points as f64) / sum(|q| q.n_points as f64),
        worst_excess_m: most(|q| q.worst_excess_m),
    };
    row("all", all, &whole);
}

/// The URDF with each link's collision elements replaced; all else stays as it was written.
fn with_balls(text: &str, bodies: &[Body], balls: &[Balls]) -> Result<String, String> {
    let document = roxmltree::Document::parse(text).map_err(|error| error.to_string())?;
    // Ranges of the text with what takes their place.
    let mut edits: Vec<(std::ops::Range<usize>, String)> = Vec::new();
    let links = document.root_element().children().filter(|node| node.has_tag_name("link"));
    for link in links {
        let name = link.attribute("name").unwrap_or_default();
        let Some(nth) = bodies.iter().position(|body| body.link == name) else { continue };
        let mut elements = String::new();
        for (centre, radius) in &balls[nth] {
            // Rounded up: what is covered stays covered.
            let (x, y, z, r) = (centre.x, centre.y, centre.z, radius + 2e-6);
            write!(
                elements,
                "<collision><origin xyz=\"{x:.6} {y:.6} {z:.6}\" rpy=\"0 0 0\"/>\
                 <geometry><sphere radius=\"{r:.6}\"/></geometry></collision>\n    "
            )
            .map_err(|error| error.to_string())?;
        }
        for (idx, collision) in link.children().filter(|node| node.has_tag_name("collision")).enumerate() {
            edits.push((collision.range(), if idx == 0 { elements.trim_end().to_owned() } else { String::new() }));
        }
    }
    let mut all = text.to_owned();
    for (range, new) in edits.into_iter().rev() {
        all.replace_range(range, &new);
    }
    Ok(all)
}

/// Pairs of links whose balls touch in every random configuration: they are built so.
fn touching_pairs(tree: &Tree, bodies: &[Body], balls: &[Balls]) -> Result<BTreeSet<(String, String)>> {
    let links = bodies.iter().map(|body| tree.link_idx(&body.link)).collect::<Result<Vec<_>, _>>()?;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut pairs: Vec<(usize, usize)> = (0..bodies.len()).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    for _ in 0..N_SAMPLES {
        let poses = tree.link_poses(&random_configuration(tree, &mut rng));
        pairs.retain(|(a, b)| {
            let a_from_b = poses[links[*a]].inverse() * poses[links[*b]];
            balls[*b].iter().any(|(centre, radius)| {
                let centre = a_from_b * centre;
                balls[*a].iter().any(|(other, r)| (centre - other).norm() < radius + r)
            })
        });
    }
    Ok(pairs.into_iter().map(|(a, b)| (bodies[a].link.clone(), bodies[b].link.clone())).collect())
}

fn random_configuration(tree: &Tree, rng: &mut ChaCha8Rng) -> Vec<f64> {
    use rand::Rng as _;
    let value = |q_idx: usize| {
        let joint = tree.independent_joint(q_idx);
        let pi = std::f64::consts::PI;
        let (low, high) = (joint.lower.max(-pi), joint.upper.min(pi));
        if low < high { rng.random_range(low..high) } else { low }
    };
    (0..tree.n_q()).map(value).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn options(urdf: &Path) -> Options {
        Options { urdf: urdf.to_owned(), excess_m: 0.01, count: None, packages: Vec::new(), compare: None, out: None }
    }

    #[test]
    fn collision_elements_are_replaced_and_all_else_stays() {
        let text = "<robot name='r'><!-- kept --><link name='a'><visual/>\
                    <collision><geometry><box size='1 1 1'/></geometry></collision>\n\
                    <collision name='x'><geometry><sphere radius='1'/></geometry></collision></link><link name='b'/></robot>";
        let bodies = [Body { link: "a".to_owned(), surfaces: Vec::new() }];
        let covered = with_balls(text, &bodies, &[vec![(Point::new(0.1, -0.2, 0.3), 0.5), (Point::origin(), 0.25)]]).unwrap();
        assert!(covered.contains("<!-- kept --><link name='a'><visual/><collision><origin xyz=\"0.100000 -0.200000 0.300000\""));
        assert!(
            covered.ends_with("</link><link name='b'/></robot>") && !covered.contains("box") && !covered.contains("name='x'")
        );
        let document = roxmltree::Document::parse(&covered).unwrap();
        let radii: Vec<f64> = document.descendants().filter_map(|node| node.attribute("radius")?.parse().ok()).collect();
        assert!(radii.len() == 2 && radii[0] >= 0.5 && radii[1] >= 0.25, "{radii:?}");
    }

    #[test]
    fn packages_are_found_above_the_urdf_beside_it_or_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |path: &str| folder.path().join(path);
        std::fs::create_dir_all(at("arm_description/urdf")).unwrap();
        std::fs::create_dir_all(at("hand_description")).unwrap();
        for mesh in ["arm_description/link.stl", "hand_description/palm.stl", "arm_description/urdf/near.stl"] {
            std::fs::write(at(mesh), "").unwrap();
        }
        let mut options = options(&at("arm_description/urdf/arm.urdf"));
        let found = |file: &str, options: &Options| mesh_path(file, options).map(|path| path.canonicalize().unwrap());
        let real = |path: &str| Ok(at(path).canonicalize().unwrap());
        assert_eq!(found("package://arm_description/link.stl", &options), real("arm_description/link.stl"));
        assert_eq!(found("package://hand_description/palm.stl", &options), real("hand_description/palm.stl"));
        assert_eq!(found("near.stl", &options), real("arm_description/urdf/near.stl"));
        let error = mesh_path("package://base/plate.stl", &options).unwrap_err();
        assert!(error.contains("--package base=FOLDER"), "{error}");
        assert!(mesh_path("far.stl", &options).unwrap_err().contains("there is no file"));
        options.packages = vec![format!("base={}", at("hand_description").display())];
        assert_eq!(found("package://base/palm.stl", &options), real("hand_description/palm.stl"));
    }
}
