//! Pages in a Chromium without a screen, and scenes to look at; shared by the tests of what browsers show.

#![allow(dead_code)] // each test file includes this module and uses a part of it

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

/// A Chromium of this machine.
pub fn chromium() -> Option<PathBuf> {
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    let found = found.into_iter().find(|path| path.is_file());
    if found.is_none() {
        println!("skipped: there is no Chromium in PATH");
    }
    found
}

/// Opens an address; what Chromium writes to standard output.
pub fn visit(chromium: &Path, profile: &Path, address: &str, flags: &[String]) -> String {
    let mut command = Command::new(chromium);
    command
        .args(["--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"])
        .args(["--enable-unsafe-swiftshader", "--hide-scrollbars", "--force-device-scale-factor=1"])
        .args(["--no-first-run", "--disable-background-networking", "--virtual-time-budget=10000"])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(flags)
        .arg(address)
        .stderr(Stdio::null());
    let output = command.output().expect("Chromium runs");
    assert!(output.status.success(), "{}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// JSON as it may stand behind `#` in an address.
pub fn escaped(value: &Value) -> String {
    value.to_string().bytes().map(|byte| format!("%{byte:02X}")).collect()
}

/// The picture of an address, as wide and high as given.
pub fn shot(chromium: &Path, folder: &Path, address: &str, [width, height]: [u32; 2]) -> image::RgbImage {
    let path = folder.join("shot.png");
    let _ = std::fs::remove_file(&path);
    let flags = [format!("--window-size={width},{height}"), format!("--screenshot={}", path.display())];
    visit(chromium, &folder.join("profile"), address, &flags);
    let shown = image::open(&path).expect("a screenshot").to_rgb8();
    assert_eq!(shown.dimensions(), (width, height));
    shown
}

/// Root mean square difference of two pictures over all channels, of 255; and the mean of the second.
pub fn rms(shown: &image::RgbImage, expected: &[[u8; 3]]) -> (f64, f64) {
    assert_eq!(shown.pixels().len(), expected.len());
    let (mut sum, mut light) = (0.0, 0.0);
    for (a, b) in shown.pixels().zip(expected) {
        sum += (0..3).map(|c| (f64::from(a.0[c]) - f64::from(b[c])).powi(2)).sum::<f64>();
        light += b.map(f64::from).iter().sum::<f64>();
    }
    let count = 3.0 * expected.len() as f64;
    ((sum / count).sqrt(), light / count)
}

/// A PLY of `n` times `n` quads, halved, over (u, v) in the unit square; its front is where u turns left to v.
pub fn grid(n: u32, at: impl Fn(f64, f64) -> [f64; 3]) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (n + 1) * (n + 1),
        2 * n * n
    );
    for i in 0..=n {
        for j in 0..=n {
            let [x, y, z] = at(f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            writeln!(text, "{x} {y} {z}").expect("text takes all");
        }
    }
    for i in 0..n {
        for j in 0..n {
            let [a, b] = [i * (n + 1) + j, (i + 1) * (n + 1) + j];
            writeln!(text, "3 {a} {b} {}\n3 {a} {} {}", b + 1, b + 1, a + 1).expect("text takes all");
        }
    }
    text
}
