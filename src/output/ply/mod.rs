//! PLY with the light of each vertex: the input file rewritten, or the merged scene where there is no one PLY to keep.

mod body;
mod columns;
mod merged;
mod rewrite;

use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;

use crate::error::{Error, Result};
use crate::output::file::Sink;
use crate::output::transfers::VertexTransfers;
use crate::output::vertices::{VertexField, VertexLight};
use crate::output::{Advance, Evaluate};
use crate::scene::Scene;

/// Vertices written at a time.
const BATCH: usize = 1 << 12;

/// Writes the light of every vertex to `path` as binary little-endian PLY.
///
/// A scene of one PLY mesh keeps that file's elements, properties and orders: colours that it has are replaced by the
/// lit ones and kept as `input_red`, `input_green`, `input_blue`; everything else is appended. Any other scene is
/// written as one mesh of its triangles in world coordinates. `advance` counts vertices.
///
/// # Errors
/// [`Error::Usage`] when `path` is the input itself, [`Error::Input`] when the input changed since it was read,
/// input/output errors, and what `advance` says.
pub fn export(path: &Path, scene: &Scene, evaluate: &Evaluate<'_>, advance: &Advance<'_>) -> Result<()> {
    export_with((path, scene), evaluate, advance, &VertexTransfers::default())
}

/// As [`export`], with what skies of harmonics do at each vertex.
///
/// # Errors
/// As [`export`]; [`Error::Usage`] when the input has such columns already.
pub fn export_with(
    (path, scene): (&Path, &Scene),
    evaluate: &Evaluate<'_>,
    advance: &Advance<'_>,
    transfers: &VertexTransfers,
) -> Result<()> {
    if scene.meshes.iter().any(|mesh| is_same(&mesh.file, path)) {
        return Err(Error::Usage(format!("{}: would overwrite the scene's own mesh", path.display())));
    }
    let field = VertexField::new(scene, evaluate, advance)?;
    let counted = |_| advance(0);
    let work = Work { exposure: field.exposure(), lights: &field, advance: &counted, transfers };
    match &scene.meshes[..] {
        [mesh] if mesh.file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ply")) => {
            rewrite::write(path, &mesh.file, &work)
        }
        _ => merged::write(path, scene, field.normals(), &work),
    }
}

/// As [`export`], for a PLY whose vertices' light comes from elsewhere, in the order of the file.
///
/// # Errors
/// As [`export`], and what `lights` says.
pub fn rewrite(
    (path, source): (&Path, &Path),
    lights: &dyn Lights,
    exposure: f32,
    advance: &Advance<'_>,
) -> Result<()> {
    if is_same(path, source) {
        return Err(Error::Usage(format!("{}: would overwrite the scene's own mesh", path.display())));
    }
    rewrite::write(path, source, &Work { lights, exposure, advance, transfers: &VertexTransfers::default() })
}

/// The light of a file's vertices.
pub trait Lights: Sync {
    /// How many there are.
    fn count(&self) -> usize;

    /// That of a range of them, in order.
    ///
    /// # Errors
    /// Those of finding it.
    fn light(&self, range: Range<usize>) -> Result<Vec<VertexLight>>;
}

impl Lights for VertexField<'_> {
    fn count(&self) -> usize {
        self.normals().len()
    }

    fn light(&self, range: Range<usize>) -> Result<Vec<VertexLight>> {
        Ok(Self::light(self, range))
    }
}

/// Whether both paths lead to one file.
fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// What both ways of writing share.
struct Work<'a> {
    lights: &'a dyn Lights,
    exposure: f32,
    advance: &'a Advance<'a>,
    transfers: &'a VertexTransfers,
}

impl Work<'_> {
    /// Calls `each` with the light of one vertex after the other.
    fn for_each(&self, count: usize, mut each: impl FnMut(usize, &VertexLight) -> Result<()>) -> Result<()> {
        for start in (0..count).step_by(BATCH) {
            let range: Range<usize> = start..(start + BATCH).min(count);
            for (vertex, light) in range.clone().zip(self.lights.light(range.clone())?) {
                each(vertex, &light)?;
            }
            (self.advance)(range.len() as u64)?;
        }
        Ok(())
    }

    /// Header comments: colour space, exposure, units.
    fn comments(&self) -> String {
        format!(
            "comment glowtree: radiosity and irradiance are linear Rec.709 in W/m^2\n\
             comment glowtree: red green blue are sRGB of exposure * radiosity, exposure {}\n\
             comment glowtree: ambient_occlusion is the cosine-weighted share of the sky that the vertex sees\n\
             comment glowtree: error is the estimated standard error of mean-channel irradiance in W/m^2\n{}",
            self.exposure,
            self.transfers.comments()
        )
    }
}

/// Writes to the sink of `path`.
fn put(path: &Path, sink: &mut Sink, bytes: &[u8]) -> Result<()> {
    sink.write_all(bytes).map_err(|e: io::Error| Error::io(path, "writing", e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;
    use crate::scene;
    use glam::{DVec3, Vec3};

    const ASCII: &str = "ply\nformat ascii 1.0\nobj_info scanned today\ncomment by hand\nelement vertex 4\n\
        property double x\nproperty float y\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
        property float z\nproperty float quality\nelement face 2\nproperty list uchar int vertex_indices\n\
        property short flags\nelement extra 1\nproperty list ushort double values\nend_header\n\
        0.1 0 10 20 30 0 nan\n1 0 40 50 60 0 .5\n1 1 70 80 90 0 2\n7 7 1 2 3 7 -1e-3\n3 0 1 2 -7\n3 2 1 0 300\n2 0.1 1e300\n";

    /// The same file by hand, binary, either byte order.
    fn binary(big: bool) -> Vec<u8> {
        let order = if big { "big" } else { "little" };
        let mut bytes = ASCII.replace("ascii", &format!("binary_{order}_endian")).into_bytes();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        bytes.truncate(end);
        let mut put = |little: &[u8]| {
            let mut word = little.to_vec();
            if big {
                word.reverse();
            }
            bytes.extend(word);
        };
        for (x, y, rgb, z, q) in [
            (0.1f64, 0.0f32, [10u8, 20, 30], 0.0f32, f32::NAN),
            (1.0, 0.0, [40, 50, 60], 0.0, 0.5),
            (1.0, 1.0, [70, 80, 90], 0.0, 2.0),
            (7.0, 7.0, [1, 2, 3], 7.0, -1e-3),
        ] {
            put(&x.to_le_bytes());
            put(&y.to_le_bytes());
            rgb.iter().for_each(|c| put(&[*c]));
            put(&z.to_le_bytes());
            put(&q.to_le_bytes());
        }
        for (face, flags) in [([0i32, 1, 2], -7i16), ([2, 1, 0], 300)] {
            put(&[3]);
            face.iter().for_each(|k| put(&k.to_le_bytes()));
            put(&flags.to_le_bytes());
        }
        put(&2u16.to_le_bytes());
        put(&0.1f64.to_le_bytes());
        put(&1e300f64.to_le_bytes());
        bytes
    }

    fn exported(input: &[u8]) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("in.ply"), folder.path().join("out.ply"));
        std::fs::write(&from, input).unwrap();
        let scene = scene::load(&from).unwrap();
        export(&to, &scene, &synthetic::light, &|_| Ok(())).unwrap();
        assert_eq!(export(&from, &scene, &synthetic::light, &|_| Ok(())).unwrap_err().exit_code(), 2);
        std::fs::read(&to).unwrap()
    }

    fn body(bytes: &[u8]) -> &[u8] {
        &bytes[bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11..]
    }

    #[test]
    fn all_encodings_keep_every_number_and_give_the_same_bytes() {
        let little = exported(&binary(false));
        assert_eq!(body(&little), body(&exported(&binary(true))));
        assert_eq!(body(&little), body(&exported(ASCII.as_bytes())));
        let original = binary(false);
        // Rows: 8 + 4 + 3 + 4 + 4 bytes in, 8 floats and the 3 input colours more out (red, green, blue replaced).
        let (old, new) = (body(&original), body(&little));
        let (before, after) = (23, 23 + 32 + 3);
        for row in 0..4 {
            let (a, b) = (&old[row * before..][..before], &new[row * after..][..after]);
            assert_eq!((&a[..12], &a[15..23]), (&b[..12], &b[15..23]), "row {row}");
            assert_eq!(&a[12..15], &b[after - 3..], "input colours of row {row}");
        }
        assert_eq!(&old[4 * before..], &new[4 * after..], "what follows the vertices");
        // The fourth vertex is in no face: zeros, black.
        assert_eq!(&new[3 * after + 23..4 * after - 3], &[0u8; 32]);
        assert_eq!(&new[3 * after + 12..3 * after + 15], &[0u8; 3]);
        // Front and back cancel; the first face's normal +z decides: irradiance (0.75, 0.75, 1.25).
        let float = |at: usize| f32::from_le_bytes(new[at..at + 4].try_into().unwrap());
        assert_eq!([float(35), float(39), float(43)], [0.75, 0.75, 1.25]);
        assert_eq!((float(47), float(51)), (1.0 / 3.0, 0.125));
    }

    #[test]
    fn the_header_keeps_what_was_there_and_says_what_is_new() {
        let bytes = exported(ASCII.as_bytes());
        let header = String::from_utf8_lossy(&bytes[..bytes.len() - body(&bytes).len()]).into_owned();
        for line in [
            "format binary_little_endian 1.0",
            "obj_info scanned today",
            "comment by hand",
            "property short flags",
            "property list ushort double values",
            "property float quality\nproperty float radiosity_r",
            "property float error\nproperty uchar input_red",
        ] {
            assert!(header.contains(line), "{line}: {header}");
        }
        assert!(header.contains("exposure ") && header.contains("W/m^2") && header.contains("Rec.709"));
        assert_eq!(header.matches("property uchar red").count(), 1);
        // Exporting what was exported adds nothing: values are replaced.
        let again = exported(&bytes);
        let twice = String::from_utf8_lossy(&again[..again.len() - body(&again).len()]).into_owned();
        assert_eq!(twice.matches("property").count(), header.matches("property").count(), "{twice}");
    }

    #[test]
    fn a_file_that_changed_since_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let from = folder.path().join("in.ply");
        std::fs::write(&from, ASCII).unwrap();
        let scene = scene::load(&from).unwrap();
        std::fs::write(&from, ASCII.replace("vertex 4", "vertex 3")).unwrap();
        let refused = export(&folder.path().join("o.ply"), &scene, &synthetic::light, &|_| Ok(()));
        assert_eq!(refused.unwrap_err().exit_code(), 4);
        std::fs::write(&from, &ASCII[..ASCII.len() - 40]).unwrap();
        let refused = export(&folder.path().join("o.ply"), &scene, &synthetic::light, &|_| Ok(()));
        assert_eq!(refused.unwrap_err().exit_code(), 4);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn several_meshes_become_one_in_world_coordinates() {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = synthetic::square();
        scene.meshes[0].file = "mesh.obj".into();
        scene.placement.scale = 2.0;
        scene.placement.origin = DVec3::new(10.0, 0.0, 0.0);
        let to = folder.path().join("o.ply");
        export(&to, &scene, &synthetic::light, &|_| Ok(())).unwrap();
        let read = scene::load(&to).unwrap();
        assert_eq!((read.vertices.len(), read.triangles.clone()), (4, scene.triangles.clone()));
        let world = read.placement.to_world(read.vertices[2]);
        assert!((world - DVec3::new(12.0, 2.0, 0.0)).length() < 1e-6, "{world}");
        assert_eq!(read.meshes[0].normals.as_deref(), Some(&[Vec3::Z; 4][..]));
        scene.placement.origin.x = 5.0e6;
        export(&to, &scene, &synthetic::light, &|_| Ok(())).unwrap();
        assert!(String::from_utf8_lossy(&std::fs::read(&to).unwrap()).contains("property double x"));
    }
}
