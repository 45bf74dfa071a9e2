//! Wavefront OBJ text: positions, faces and `o` groups; everything else is passed over.

use super::TriMesh;
use crate::GeometryError;
use nalgebra::Point3;
use std::fmt::Write as _;
use std::path::Path;

impl TriMesh {
    /// Reads all faces of an OBJ file as one mesh.
    ///
    /// # Errors
    /// As [`TriMesh::from_obj_str`], and [`GeometryError::Io`] when the file cannot be read.
    pub fn read_obj(path: &Path) -> Result<Self, GeometryError> {
        Self::from_obj_str(&read(path)?, path)
    }

    /// Reads the `o NAME` groups of an OBJ file, in file order, each with its own vertices.
    ///
    /// # Errors
    /// As [`TriMesh::read_obj`].
    pub fn read_obj_groups(path: &Path) -> Result<Vec<(String, Self)>, GeometryError> {
        let parsed = parse(&read(path)?, path)?;
        Ok(parsed
            .groups
            .into_iter()
            .map(|(name, triangles)| {
                let mut new_index = vec![u32::MAX; parsed.vertices.len()];
                let mut mesh = Self::default();
                for t in triangles {
                    mesh.triangles.push(t.map(|v| {
                        let slot = &mut new_index[v as usize];
                        if *slot == u32::MAX {
                            *slot = mesh.vertices.len() as u32;
                            mesh.vertices.push(parsed.vertices[v as usize]);
                        }
                        *slot
                    }));
                }
                (name, mesh)
            })
            .collect())
    }

    /// Reads all faces of OBJ text as one mesh; polygons become fans. `file` only names the source in messages.
    ///
    /// # Errors
    /// [`GeometryError::BadMesh`] with the line for a number that is not finite, an index without vertex or a face with fewer
    /// than three corners, and without one when there is no face at all.
    pub fn from_obj_str(text: &str, file: &Path) -> Result<Self, GeometryError> {
        let parsed = parse(text, file)?;
        Ok(Self::new(parsed.vertices, parsed.groups.into_iter().flat_map(|(_, triangles)| triangles).collect()))
    }

    /// OBJ text with the given comment lines first.
    #[must_use]
    pub fn to_obj(&self, comment: &str) -> String {
        let mut text = String::new();
        for line in comment.lines() {
            let _ = writeln!(text, "# {line}");
        }
        for v in &self.vertices {
            let _ = writeln!(text, "v {:.6} {:.6} {:.6}", v.x, v.y, v.z);
        }
        for t in &self.triangles {
            let _ = writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1);
        }
        text
    }

    /// Writes [`TriMesh::to_obj`] to a file.
    ///
    /// # Errors
    /// [`GeometryError::Io`] when the file cannot be written.
    pub fn write_obj(&self, path: &Path, comment: &str) -> Result<(), GeometryError> {
        std::fs::write(path, self.to_obj(comment)).map_err(|source| GeometryError::Io { file: path.to_owned(), source })
    }
}

struct Parsed {
    vertices: Vec<Point3<f64>>,
    groups: Vec<(String, Vec<[u32; 3]>)>,
}

fn read(path: &Path) -> Result<String, GeometryError> {
    std::fs::read_to_string(path).map_err(|source| GeometryError::Io { file: path.to_owned(), source })
}

fn parse(text: &str, file: &Path) -> Result<Parsed, GeometryError> {
    let bad = |line: usize, message: String| GeometryError::BadMesh { file: file.to_owned(), line, message };
    let mut vertices = Vec::new();
    let mut groups: Vec<(String, Vec<[u32; 3]>)> = Vec::new();
    let mut face = Vec::new();
    for (line_idx, line) in text.lines().enumerate() {
        let line_no = line_idx + 1;
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let mut xyz = [0.0_f64; 3];
                for (value, axis) in xyz.iter_mut().zip(["x", "y", "z"]) {
                    let word = words.next().unwrap_or("");
                    *value = word
                        .parse()
                        .ok()
                        .filter(|v: &f64| v.is_finite())
                        .ok_or_else(|| bad(line_no, format!("vertex coordinate {axis} is {word:?}, not a finite number")))?;
                }
                vertices.push(Point3::from(xyz));
            }
            Some("f") => {
                face.clear();
                for word in words {
                    let number: i64 = word
                        .split('/')
                        .next()
                        .and_then(|w| w.parse().ok())
                        .ok_or_else(|| bad(line_no, format!("face corner {word:?} is not an index")))?;
                    // Negative numbers count back from the newest vertex.
                    let idx = if number > 0 { number - 1 } else { vertices.len() as i64 + number };
                    if number == 0 || idx < 0 || idx >= vertices.len() as i64 {
                        return Err(bad(line_no, format!("face names vertex {number}, {} are defined", vertices.len())));
                    }
                    face.push(idx as u32);
                }
                if face.len() < 3 {
                    return Err(bad(line_no, format!("face has {} corners, 3 are needed", face.len())));
                }
                if groups.is_empty() {
                    groups.push((String::new(), Vec::new()));
                }
                if let Some((_, triangles)) = groups.last_mut() {
                    triangles.extend((1..face.len() - 1).map(|i| [face[0], face[i], face[i + 1]]));
                }
            }
            Some("o") => groups.push((words.next().unwrap_or("").to_owned(), Vec::new())),
            _ => {}
        }
    }
    groups.retain(|(_, triangles)| !triangles.is_empty());
    if groups.is_empty() {
        return Err(bad(0, format!("no faces ({} vertices)", vertices.len())));
    }
    Ok(Parsed { vertices, groups })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::mesh;

    #[track_caller]
    fn check_error(text: &str, expected: &str) {
        let error = TriMesh::from_obj_str(text, Path::new("a.obj")).unwrap_err();
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn a_broken_file_is_named_with_its_line() {
        check_error("v 0 0 0\nv 0 NaN 1\n", "a.obj:2: vertex coordinate y is \"NaN\", not a finite number");
        check_error("v 0 0\n", "a.obj:1: vertex coordinate z is \"\", not a finite number");
        check_error("v 0 0 0\nf 1 2 3\n", "a.obj:2: face names vertex 2, 1 are defined");
        check_error("v 0 0 0\nf 1 1\n", "a.obj:2: face has 2 corners, 3 are needed");
        check_error("v 0 0 0\n", "a.obj:0: no faces (1 vertices)");
        check_error("f a b c\n", "a.obj:1: face corner \"a\" is not an index");
    }

    #[test]
    fn writing_and_reading_gives_the_same_mesh() {
        let mesh = mesh::sphere(0.05, 12);
        let again = TriMesh::from_obj_str(&mesh.to_obj("a ball"), Path::new("ball.obj")).unwrap();
        assert_eq!(again.triangles, mesh.triangles);
        assert!(again.vertices.iter().zip(&mesh.vertices).all(|(a, b)| (a - b).norm() < 1e-6));
    }

    #[test]
    fn polygons_slashes_and_negative_indices_are_understood() {
        let text = "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1/1 2//2 3 4\no b\nf -4 -2 -1\n";
        let mesh = TriMesh::from_obj_str(text, Path::new("a.obj")).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
    }
}
