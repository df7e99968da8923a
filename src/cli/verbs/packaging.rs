//! `glowtree completions SHELL` and `glowtree man`

use clap::CommandFactory;
use serde::Serialize;

use crate::cli::arguments::{Arguments, Completions};
use crate::cli::console::{self, Console};
use crate::error::{Error, Result};

/// The figures of a verb that prints a text.
#[derive(Debug, Serialize)]
struct Printed<'a> {
    text: &'a str,
}

/// Prints a completion script.
pub fn completions(request: &Completions, console: &Console) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(request.shell, &mut Arguments::command(), "glowtree", &mut script);
    publish("completions", &script, console)
}

/// Prints the manual page: the program's own, then one section per verb.
pub fn manual(console: &Console) -> Result<()> {
    let mut page = Vec::new();
    let mut command = Arguments::command();
    command.build();
    let failed = |e| Error::io(console::STANDARD_OUTPUT, "making the manual page", e);
    clap_mangen::Man::new(command.clone()).render(&mut page).map_err(failed)?;
    for verb in command.get_subcommands().filter(|verb| verb.get_name() != "help") {
        let manual = clap_mangen::Man::new(verb.clone());
        let mut section = Vec::new();
        manual.render_name_section(&mut section).map_err(failed)?;
        manual.render_synopsis_section(&mut section).map_err(failed)?;
        manual.render_options_section(&mut section).map_err(failed)?;
        let titled = format!("GLOWTREE {}", verb.get_name().to_uppercase());
        page.extend(
            String::from_utf8_lossy(&section).replace(".SH NAME", &format!(".SH \"{titled}\"")).bytes(),
        );
    }
    publish("man", &page, console)
}

fn publish(verb: &str, text: &[u8], console: &Console) -> Result<()> {
    if console.json() {
        return console.summary(verb, Printed { text: &String::from_utf8_lossy(text) });
    }
    console::print(text)
}
