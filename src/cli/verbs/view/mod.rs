//! `glowtree view JOB`: the page of `export -o view.html` from a server on loopback that solves what sliders cannot.

mod desk;
mod edit;
mod live;
mod request;
mod serve;

use std::sync::Arc;
use std::thread::Builder;

use serde::Serialize;

use super::page::Shown;
use crate::bake::Monitor as _;
use crate::cli::arguments::View;
use crate::cli::console::{self, Console};
use crate::error::{Error, Result};
use crate::output::viewer;
use desk::Desk;
use live::Live;
use request::Gate;
use serve::House;

/// The line that says where the page is.
#[derive(Debug, Serialize)]
struct Serving<'a> {
    r#type: &'static str,
    /// With the token.
    url: &'a str,
    port: u16,
}

/// Serves the page until a signal comes.
///
/// # Errors
/// Those of opening the job, a port that is taken, and [`Error::Interrupted`] in the end.
pub fn run(request: &View, console: &Console) -> Result<()> {
    // A port that is taken is told before any work.
    let (listener, port) = serve::listen(request.port)?;
    let mut shown = Shown::open(&request.job, request.vertices as usize, console)?;
    let controls = edit::controls(shown.relighter.scene(), shown.relighter.baked());
    let mut picture = shown.picture(&request.job)?;
    let raw = picture.lit.lights.iter().map(|light| light.irradiance.clone()).collect();
    picture.lighten_hidden();
    let page = viewer::served(&picture, &controls)?;
    let (mesh, level) = (picture.mesh, picture.level);
    shown.relighter.model().bvh.sound()?;
    let live = Live::new(shown, mesh, raw, level);
    let token = serve::token()?;
    let url = format!("http://127.0.0.1:{port}/{token}/");
    let house = Arc::new(House { gate: Gate { token, port }, page, desk: Desk::default() });
    let own = Arc::clone(&house);
    let solver = Builder::new().name("solver".into()).spawn(move || live.work(&own.desk));
    let solver = solver.map_err(|e| Error::OutOfMemory { action: format!("starting a thread: {e}") })?;
    if console.json() {
        console::line(&Serving { r#type: "serving", url: &url, port })?;
    } else {
        console::print(format!("{url}\n").as_bytes())?;
        console.note("open this address in a browser of this machine; Ctrl-C ends");
    }
    serve::run(&listener, &house, solver, console)
}
