//! Draws every model of `scenarios/objects` beside the others: `cargo run -p sfg-render --example contact_sheet`.
//!
//! Writes `target/contact_sheet.png`: above as cameras see them, below their collision pieces.
#![expect(clippy::print_stdout, reason = "a command line example")]

use sfg_geometry::{ObjectInstance, ObjectModel, Piece, TriMesh, mesh};
use sfg_render::{Finish, Item, Picture, RenderMesh, Scene, camera, render_smooth};
use sfg_types::{Point, Pose};
use std::error::Error;
use std::path::Path;

const CELL: (usize, usize) = (320, 260);

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut files: Vec<_> =
        std::fs::read_dir(root.join("scenarios/objects"))?.map(|f| f.map(|f| f.path())).collect::<Result<_, _>>()?;
    files.retain(|path| path.extension().is_some_and(|e| e == "yaml"));
    files.sort();
    let mut cells = Vec::new();
    for file in &files {
        let model: ObjectModel = serde_saphyr::from_str(&std::fs::read_to_string(file)?)?;
        let object = model.instantiate(&model.nominal_params())?;
        println!(
            "{:10} {:3} pieces, {:6.1} ml of material, {:6.1} ml inside, centre of mass at {:.3} m",
            object.category,
            object.pieces.len(),
            object.mass.volume_m3 * 1e6,
            object.interior.as_ref().map_or(0.0, |i| i.volume_m3() * 1e6),
            object.mass.centre_of_mass_in_object.z,
        );
        cells.push(Picture::stacked(&[draw(&object, false), draw(&object, true)], 2));
    }
    let rows: Vec<Picture> = cells.chunks(5).map(|row| Picture::beside(row, 2)).collect();
    let out = root.join("target/contact_sheet.png");
    std::fs::write(&out, Picture::stacked(&rows, 8).png()?)?;
    println!("wrote {}", out.display());
    Ok(())
}

fn draw(object: &ObjectInstance, as_pieces: bool) -> Picture {
    let parts: Vec<(RenderMesh, [u8; 3])> = if as_pieces {
        let pieces = object.pieces.iter().enumerate();
        pieces.map(|(idx, p)| (RenderMesh::new(&piece_mesh(&p.piece).transformed(&p.object_from_piece)), hue(idx))).collect()
    } else {
        object.display_meshes().iter().map(|d| (RenderMesh::new(&d.mesh), d.colour)).collect()
    };
    let table = RenderMesh::new(&mesh::cuboid(&nalgebra::Vector3::new(0.6, 0.6, 0.01)));
    let item = |mesh, base_from_mesh, colour, finish| Item { mesh, base_from_mesh, colour, finish, instance_id: 0, part_id: 0 };
    let mut scene = Scene::default();
    scene.items.push(item(&table, Pose::translation(0.0, 0.0, -0.01), [196, 160, 118], Finish::Wood));
    scene.items.extend(parts.iter().map(|(mesh, colour)| item(mesh, Pose::identity(), *colour, Finish::Plain)));
    let (low, high) = object.bounds();
    let middle = nalgebra::center(&low, &high);
    let size = (high - low).norm();
    let eye = middle + nalgebra::Vector3::new(-0.55, -1.0, 0.75).normalize() * (size * 1.65);
    let lens = camera::intrinsics(CELL.0, CELL.1, 0.75);
    let mut picture = Picture::from_frame(&render_smooth(&scene, &lens, &camera::look_at(&Point::from(eye), &middle)));
    let name = if as_pieces { format!("{} pieces", object.pieces.len()) } else { object.category.clone() };
    picture.label(6, 6, 2, [255; 3], [40, 44, 52], &name);
    picture
}

fn piece_mesh(piece: &Piece) -> TriMesh {
    match piece {
        Piece::Cuboid { half_extents_m } => mesh::cuboid(half_extents_m),
        Piece::Cylinder { half_height_m, radius_m } => mesh::cylinder(*half_height_m, *radius_m, 32),
        Piece::Capsule { half_height_m, radius_m } => mesh::capsule(*half_height_m, *radius_m, 16),
        Piece::Ball { radius_m } => mesh::sphere(*radius_m, 32),
        Piece::ConvexHull { points } => mesh::convex_hull(points),
    }
}

fn hue(idx: usize) -> [u8; 3] {
    [[230, 90, 80], [90, 170, 90], [80, 120, 220], [230, 180, 60], [160, 90, 190], [70, 180, 190]][idx % 6]
}
