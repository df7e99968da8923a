//! Runs the program and looks at what it says; shared by the tests of the command line.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of its own for a test, with a small lit scene in it.
pub struct Place {
    folder: tempfile::TempDir,
}

/// A room-like corner: floor and wall, and a lamp above, 60 triangles or so.
const SCENE: &str = r#"
[[mesh]]
file = "corner.ply"
albedo = "vertex"

[[lamp]]
kind = "point"
position = [0.5, 0.8, 0.5]
intensity = [1, 1, 1]

[sky]
radiance = [0.2, 0.2, 0.2]

[[camera]]
name = "front"
eye = [0.5, 0.7, 2.5]
target = [0.5, 0.3, 0.0]
size = [48, 32]
fov = 40
"#;

impl Place {
    /// With `scene.toml`, `corner.ply` and `points.csv`.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let place = Self { folder };
        std::fs::write(place.path("scene.toml"), SCENE).expect("writing the scene");
        std::fs::write(place.path("corner.ply"), corner()).expect("writing the mesh");
        let points = "x,y,z,nx,ny,nz,name\n0.3,0,0.4,0,1,0,floor\n0.6,0.2,0,0,0,1,\"a, wall\"\n";
        std::fs::write(place.path("points.csv"), points).expect("writing the points");
        place
    }

    /// A path within.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the program here.
    pub fn run(&self, words: &[&str]) -> Output {
        self.command(words).output().expect("the program runs")
    }

    /// The program, ready to run here.
    pub fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_glowtree"));
        command.args(words).current_dir(self.folder.path()).env_remove("NO_COLOR");
        command
    }

    #[allow(dead_code)] // each test file includes this module and uses a part of it
    /// Bakes the scene into `job` and insists that it worked.
    pub fn baked(&self, job: &str) {
        let output = self.run(&["bake", "scene.toml", "-o", job, "--error", "20%", "--no-preview", "-q"]);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        assert!(output.stdout.is_empty(), "-q is silent: {}", stdout(&output));
    }
}

/// Floor z in [0, 1] and wall at z = 0, four quads across each, coloured; extra property `quality`.
fn corner() -> String {
    let mut vertices = String::new();
    let mut faces = String::new();
    for side in 0..2 {
        for i in 0..=4 {
            for j in 0..=4 {
                let (u, v) = (f64::from(i) / 4.0, f64::from(j) / 4.0);
                let [y, z] = if side == 0 { [0.0, v] } else { [v, 0.0] };
                vertices += &format!("{u} {y} {z} {} 180 160 {}\n", 100 + 20 * i, i * j);
            }
        }
        for i in 0..4 {
            for j in 0..4 {
                let [a, b, c, d] =
                    [[i, j], [i, j + 1], [i + 1, j + 1], [i + 1, j]].map(|[i, j]| side * 25 + i * 5 + j);
                faces +=
                    &if side == 0 { format!("4 {a} {b} {c} {d}\n") } else { format!("4 {a} {d} {c} {b}\n") };
            }
        }
    }
    format!(
        "ply\nformat ascii 1.0\ncomment a corner\nelement vertex 50\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty short quality\n\
         element face 32\nproperty list uchar int vertex_indices\nend_header\n{vertices}{faces}"
    )
}

/// The exit code; panics when a signal ended the program.
pub fn code(output: &Output) -> i32 {
    output.status.code().unwrap_or_else(|| panic!("no exit code: {:?}", output.status))
}

/// Standard error as text.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Standard output as text.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The JSON lines of standard output.
#[allow(dead_code)] // each test file includes this module and uses a part of it
pub fn lines(output: &Output) -> Vec<serde_json::Value> {
    let parse = |line: &str| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
    stdout(output).lines().map(parse).collect()
}

/// Whether a file lies there.
#[allow(dead_code)] // as above
pub fn exists(path: &Path) -> bool {
    path.exists()
}
