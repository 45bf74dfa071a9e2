//! The zero surface of a signed distance function as a closed mesh, by marching tetrahedra.

use super::TriMesh;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// The six tetrahedra of a cube about its main diagonal 0-7; corner bits are x, y, z. Neighbouring cubes agree on shared faces.
const TETRAHEDRA: [[usize; 4]; 6] = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// The closed surface where `distance` is zero, inside the box from `low` to `high`.
///
/// `distance` must be positive outside and at least Lipschitz 1 (a true distance or a lower bound of it), because cubes that
/// cannot hold surface are passed over. The box is widened by one step, so a body inside it gives a closed mesh. Vertices lie
/// on grid edges at the linear zero crossing, within about `resolution_m^2 / (8 * radius of curvature)` of the surface.
#[must_use]
pub fn surface_of(
    distance: &(dyn Fn(&Point3<f64>) -> f64 + Sync),
    low: &Point3<f64>,
    high: &Point3<f64>,
    resolution_m: f64,
) -> TriMesh {
    use rayon::prelude::*;
    let origin = low - Vector3::repeat(resolution_m);
    let n: [usize; 3] = std::array::from_fn(|axis| ((high[axis] - origin[axis]) / resolution_m).ceil() as usize + 2);
    let at = |i: usize, j: usize, k: usize| origin + Vector3::new(i as f64, j as f64, k as f64) * resolution_m;
    let index = |i: usize, j: usize, k: usize| i + n[0] * (j + n[1] * k);
    // A sample on the surface would make triangles without area: it counts as just outside.
    let values: Vec<f64> = (0..n[2])
        .into_par_iter()
        .flat_map_iter(|k| {
            (0..n[1]).flat_map(move |j| (0..n[0]).map(move |i| (i, j, k))).map(|(i, j, k)| {
                let d = distance(&at(i, j, k));
                if d.abs() < 1e-12 { 1e-12 } else { d }
            })
        })
        .collect();

    let mut mesh = TriMesh::default();
    let mut vertex_on_edge: HashMap<(usize, usize), u32> = HashMap::new();
    let position = |idx: usize| at(idx % n[0], idx / n[0] % n[1], idx / (n[0] * n[1]));
    for k in 0..n[2] - 1 {
        for j in 0..n[1] - 1 {
            for i in 0..n[0] - 1 {
                if values[index(i, j, k)].abs() > 1.75 * resolution_m {
                    continue;
                }
                let corners: [usize; 8] = std::array::from_fn(|c| index(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1)));
                for tetrahedron in TETRAHEDRA {
                    let ids = tetrahedron.map(|c| corners[c]);
                    emit(&ids, &values, &mut |a, b| {
                        let key = (a.min(b), a.max(b));
                        *vertex_on_edge.entry(key).or_insert_with(|| {
                            // Kept off the grid points, so that no two vertices of a triangle coincide.
                            let t = (values[key.0] / (values[key.0] - values[key.1])).clamp(0.01, 0.99);
                            let (p, q) = (position(key.0), position(key.1));
                            mesh.vertices.push(p + (q - p) * t);
                            (mesh.vertices.len() - 1) as u32
                        })
                    })
                    .into_iter()
                    .flatten()
                    .for_each(|t| mesh.triangles.push(t));
                }
            }
        }
    }
    mesh
}

/// The zero, one or two triangles of one positively oriented tetrahedron.
fn emit(ids: &[usize; 4], values: &[f64], vertex: &mut dyn FnMut(usize, usize) -> u32) -> [Option<[u32; 3]>; 2] {
    let inside = ids.map(|id| values[id] < 0.0);
    // An even permutation of the corners keeps the orientation; the inside corners come first.
    let order: [usize; 4] = match inside.map(u8::from) {
        [1, 0, 0, 0] | [0, 1, 1, 1] => [0, 1, 2, 3],
        [0, 1, 0, 0] | [1, 0, 1, 1] => [1, 0, 3, 2],
        [0, 0, 1, 0] | [1, 1, 0, 1] => [2, 0, 1, 3],
        [0, 0, 0, 1] | [1, 1, 1, 0] => [3, 0, 2, 1],
        [1, 1, 0, 0] | [0, 0, 1, 1] => [0, 1, 2, 3],
        [1, 0, 1, 0] | [0, 1, 0, 1] => [0, 2, 3, 1],
        [1, 0, 0, 1] | [0, 1, 1, 0] => [0, 3, 1, 2],
        _ => return [None, None],
    };
    let [a, b, c, d] = order.map(|o| ids[o]);
    let n_inside = inside.iter().filter(|&&x| x).count();
    if n_inside == 2 {
        // a and b are on one side, c and d on the other: a quadrilateral.
        let (ac, ad, bc, bd) = (vertex(a, c), vertex(a, d), vertex(b, c), vertex(b, d));
        return if values[a] < 0.0 { [Some([ac, ad, bd]), Some([ac, bd, bc])] } else { [Some([ac, bd, ad]), Some([ac, bc, bd])] };
    }
    let (ab, ac, ad) = (vertex(a, b), vertex(a, c), vertex(a, d));
    if n_inside == 1 { [Some([ab, ac, ad]), None] } else { [Some([ab, ad, ac]), None] }
}
