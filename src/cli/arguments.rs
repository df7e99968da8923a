//! The command line's grammar.

use std::path::PathBuf;

use clap::{ArgAction, Args, Parser, Subcommand, ValueEnum};

use super::values;
use crate::basis::Basis;
use crate::links::points::Operator;
use crate::output::viewer;

/// Diffuse global illumination by meshless hierarchical radiosity.
#[derive(Debug, Parser)]
#[command(name = "glowtree", version, arg_required_else_help = true, propagate_version = true)]
pub struct Arguments {
    /// How to talk.
    #[command(flatten)]
    pub manners: Manners,
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// Flags that all verbs share.
#[derive(Debug, Clone, Args)]
pub struct Manners {
    /// Print errors only
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say more; twice for still more
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Print JSON lines on standard output and nothing else there
    #[arg(long, global = true)]
    pub json: bool,
    /// How to show progress; auto shows bars on a terminal, lines off it, JSON lines with --json
    #[arg(long, global = true, value_enum, value_name = "HOW", default_value_t = Progress::Auto)]
    pub progress: Progress,
    /// Worker threads [default: one per processor]
    #[arg(short = 'j', long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// When to colour messages
    #[arg(long, global = true, value_enum, value_name = "WHEN", default_value_t = Colour::Auto)]
    pub color: Colour,
}

/// Ways to show progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Progress {
    /// What suits the place
    Auto,
    /// Bars on standard error
    Bar,
    /// Lines on standard error: one per stage, and one every 30 seconds
    Plain,
    /// JSON lines, on standard output with --json, else on standard error
    Json,
    /// Nothing
    None,
}

/// When to colour messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Colour {
    /// On a terminal, unless NO_COLOR is set
    Auto,
    /// Always
    Always,
    /// Never
    Never,
}

/// What the program can do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Find the light of a scene and keep it in a job directory
    #[command(after_help = EXIT_CODES)]
    Bake(Bake),
    /// Answer for given surface points from a job
    Probe(Probe),
    /// Answer for given surface points by plain path tracing, with a standard error
    Reference(Reference),
    /// Write the light of a job per vertex of its mesh
    Export(Export),
    /// Make an image of a job from a camera
    Render(Render),
    /// Answer with other lights and albedos from a job, without new rows
    Relight(Relight),
    /// Show a job in a browser, and solve there for other albedos, moved lamps and a turned sky
    View(View),
    /// Show what a job holds: counts, bytes, timings, and pictures of it with --plot
    Inspect(Inspect),
    /// Recompute every checksum and invariant of a job; name what is damaged, and make it anew with --repair
    Verify(Verify),
    /// Measure: speed against accuracy, or the stability table
    Chart(Chart),
    /// Print a completion script for a shell
    Completions(Completions),
    /// Print the manual page (roff)
    Man,
}

const EXIT_CODES: &str = "Interrupted, out of disk or killed, the same command again goes on where it was.\n\
    Exit codes: 0 done, 1 other error, 2 usage, 3 job exists with other inputs or options, 4 input invalid, \
    6 over --max-memory, 7 disk full, 8 input/output error, 9 archive damaged, 10 no such job, 11 job locked, \
    12 not converged, 130/143 interrupted.";

/// `bake SCENE`
#[derive(Debug, Args)]
pub struct Bake {
    /// A mesh (.ply, .obj, .gltf, .glb) or a scene.toml
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Job directory to write; `<scene>.glow` in the working directory without it.
    #[arg(
        short,
        long,
        value_name = "JOB",
        help = "Job directory to write [default: <scene>.glow in the working directory]"
    )]
    pub output: Option<PathBuf>,
    /// Target relative RMS error of irradiance, as 2% or 0.02
    #[arg(long, value_name = "SHARE", default_value = "2%", value_parser = values::share)]
    pub error: f64,
    /// Anonymous memory to stay within, as 4GiB, 500MB or bytes
    #[arg(long, value_name = "SIZE", value_parser = values::bytes)]
    pub max_memory: Option<u64>,
    /// Leave PLY meshes of more triangles than this in their files, as 200k or 2M [default: 500k]
    #[arg(long, value_name = "N", value_parser = values::count)]
    pub resident: Option<u64>,
    /// Triangles of the proxies that stand in for meshes left in their files [default: by --error]
    #[arg(long, value_name = "N", value_parser = values::count, hide = true)]
    pub proxy: Option<u64>,
    /// Refine against each light by itself, so that any of them may be dimmed or switched later [default: when the scene
    /// has 2 to 16 lights]
    #[arg(long, value_name = "CHOICE", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub relightable: Option<bool>,
    /// Follow light over at most N reflections [default: until converged]
    #[arg(long, value_name = "N")]
    pub max_bounces: Option<u32>,
    /// Seed of every random number
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// How light is interpolated: docs/bases.md compares
    #[arg(long, value_name = "BASIS", default_value_t = Basis::default(), value_parser = values::basis())]
    pub basis: Basis,
    /// What turns radiosity into irradiance: rows of rays, or for small scenes the kernel between points
    #[arg(long, value_name = "OPERATOR", default_value_t = Operator::default(), value_parser = values::operator(), hide = true)]
    pub operator: Operator,
    /// Bake anew; what the job directory holds is kept until the new job is complete
    #[arg(long)]
    pub restart: bool,
    /// Say what the bake would take and whether disk and --max-memory allow it, and bake nothing
    #[arg(long, conflicts_with = "restart")]
    pub dry_run: bool,
    /// Write neither JOB/preview.png nor JOB/mesh.ply
    #[arg(long)]
    pub no_preview: bool,
}

/// `probe JOB`
#[derive(Debug, Args)]
pub struct Probe {
    /// A baked job directory
    #[arg(value_name = "JOB")]
    pub job: PathBuf,
    /// Table of points: x,y,z,nx,ny,nz in world coordinates; further columns are kept
    #[arg(long, value_name = "CSV")]
    pub points: PathBuf,
    /// Table to write [default: standard output]
    #[arg(short, long, value_name = "CSV")]
    pub output: Option<PathBuf>,
}

/// `reference SCENE`
#[derive(Debug, Args)]
pub struct Reference {
    /// A mesh (.ply, .obj, .gltf, .glb) or a scene.toml
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Table of points: x,y,z,nx,ny,nz in world coordinates; further columns are kept
    #[arg(long, value_name = "CSV")]
    pub points: PathBuf,
    /// Paths per point, rounded up to a multiple of 16; a power of two is best
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..))]
    pub spp: u32,
    /// Follow light over at most N reflections [default: without limit]
    #[arg(long, value_name = "N")]
    pub max_bounces: Option<u32>,
    /// Seed of every random number
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Table to write [default: standard output]
    #[arg(short, long, value_name = "CSV")]
    pub output: Option<PathBuf>,
}

/// `export JOB`
#[derive(Debug, Args)]
pub struct Export {
    /// A baked job directory
    #[arg(value_name = "JOB")]
    pub job: PathBuf,
    /// File to write: .ply with all that the mesh's file holds, .glb for viewers, or .html that shows and relights it
    #[arg(short, long, value_name = "FILE", value_parser = values::file_ending(&["ply", "glb", "html"]))]
    pub output: PathBuf,
    /// Add to each vertex what skies of N bands of spherical harmonics do there, N² vectors: precomputed radiance transfer
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=4))]
    pub transfer: Option<u8>,
}

/// `render JOB`
#[derive(Debug, Args)]
pub struct Render {
    /// A baked job directory
    #[arg(value_name = "JOB")]
    pub job: PathBuf,
    /// The scene's camera of this name [default: its first, or one that shows the whole scene]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Image to write: .exr with layers, or .png
    #[arg(short, long, value_name = "FILE", value_parser = values::file_ending(&["exr", "png"]))]
    pub output: PathBuf,
}

/// `relight JOB --set NAME.KEY=VALUE`
#[derive(Debug, Args)]
pub struct Relight {
    /// A baked job directory; it is not changed
    #[arg(value_name = "JOB")]
    pub job: PathBuf,
    /// Change a light or an albedo: NAME.radiance and NAME.albedo of a mesh, NAME.irradiance or NAME.intensity of a lamp,
    /// NAME.position, NAME.direction, sky.radiance, sky.file, sky.rotate; NAME.scale=0 switches off. Repeat for several.
    #[arg(
        long,
        value_name = "NAME.KEY=VALUE",
        help = "Change a light or an albedo, as lamp.radiance=17,12,4; repeat for several",
        long_help = "Change a light or an albedo. Keys of meshes: radiance, albedo; of suns: irradiance, direction; of points \
            and spots: intensity, position, direction; of the sky: radiance, file (a latitude-longitude image), rotate (degrees); of all that gives \
            light: scale, 0 is off. Colours are R,G,B or one number. Repeat for several; later ones see what earlier ones changed."
    )]
    pub set: Vec<String>,
    /// See the sky by N bands of spherical harmonics, N² functions, in place of itself: a sky that turns or is another then costs
    /// no solution where the job holds their transfers, and no rays
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=4))]
    pub harmonics: Option<u8>,
    /// Answer for the points of this table, as probe does
    #[arg(long, value_name = "CSV")]
    pub points: Option<PathBuf>,
    /// The scene's camera of this name, for images [default: its first, or one that shows the whole scene]
    #[arg(long, value_name = "NAME", conflicts_with = "points")]
    pub camera: Option<String>,
    /// Write a sequence: `[[key]]` tables with a frame number, a list `set` of changes as above, and eye, target, fov of the
    /// camera; frames that are there already are kept
    #[arg(long, value_name = "KEYS", conflicts_with_all = ["points", "set"], requires = "output")]
    pub animate: Option<PathBuf>,
    /// File to write: .ply, .glb, .png or .exr; .csv with --points; frame_####.png with --animate
    #[arg(short, long, value_name = "FILE", required_unless_present = "points")]
    pub output: Option<PathBuf>,
}

/// `view JOB`
#[derive(Debug, Args)]
pub struct View {
    /// A baked job directory; it is not changed
    #[arg(value_name = "JOB")]
    pub job: PathBuf,
    /// Port of 127.0.0.1 to serve at; 0 is any that is free
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub port: u16,
    /// Vertices that a scene of few is cut to; fewer are solved sooner
    #[arg(long, value_name = "N", default_value_t = viewer::VERTICES as u64, value_parser = values::count)]
    pub vertices: u64,
}

/// `inspect JOB`
#[derive(Debug, Args)]
pub struct Inspect {
    /// A baked job directory
    #[arg(value_name = "JOB")]
    pub job: PathBuf,
    /// Draw sites, levels, links, rows and errors into this folder, as SVG and PNG
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
    /// The receiver whose row and links are drawn [default: a few that tell most]
    #[arg(long, value_name = "N", requires = "plot")]
    pub receiver: Option<u32>,
}

/// `verify JOB`
#[derive(Debug, Args)]
pub struct Verify {
    /// A baked job directory
    #[arg(value_name = "JOB")]
    pub job: PathBuf,
    /// Make anew what is damaged, and nothing else; run it from where the bake ran
    #[arg(long)]
    pub repair: bool,
}

/// `chart SCENE… -o DIR`, `chart --stability`, `chart --figure3`
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["scenes", "stability", "figure3"])))]
pub struct Chart {
    /// Scenes to measure: meshes or scene.toml; `reference.csv` beside one judges it, else one is made in DIR
    #[arg(value_name = "SCENE", requires = "output")]
    pub scenes: Vec<PathBuf>,
    /// Print the stability table: seventeen hard cases; a row that does not hold says FAIL, and the exit code is 1
    #[arg(long)]
    pub stability: bool,
    /// Draw one room without radiosity, in two bases and after ten bounces, with maps of the errors
    #[arg(long, requires = "output")]
    pub figure3: bool,
    /// Folder for tables and figures; the same command again measures what is missing there
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Error targets, as 10%,5%,2%,1%
    #[arg(long, value_name = "SHARES", value_delimiter = ',', default_value = "10%,5%,2%,1%", value_parser = values::share)]
    pub errors: Vec<f64>,
    /// How light is interpolated; repeat for several
    #[arg(long, value_name = "BASIS", default_values_t = [Basis::default()], value_parser = values::basis())]
    pub basis: Vec<Basis>,
    /// Paths a point of path tracing, as 16,64; 0 for no path tracing
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "16,64,256,1024")]
    pub spp: Vec<u32>,
    /// Paths a point of a reference that is made
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..))]
    pub reference_spp: u32,
    /// Seed of every random number
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
}

/// `completions SHELL`
#[derive(Debug, Args)]
pub struct Completions {
    /// The shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_grammar_is_sound() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn flags_may_stand_before_and_after_the_verb() {
        let words =
            ["glowtree", "--json", "bake", "a.ply", "--error", "0.5%", "-j", "2", "--max-memory", "4GiB"];
        let arguments = Arguments::try_parse_from(words).unwrap();
        assert!(arguments.manners.json && arguments.manners.threads == Some(2));
        let Verb::Bake(bake) = arguments.verb else { panic!("{arguments:?}") };
        assert_eq!((bake.error, bake.max_memory), (0.005, Some(4 << 30)));
    }
}
