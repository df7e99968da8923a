//! The stability table as aligned text, as CSV and as Markdown.

use std::fmt::Write;
use std::path::Path;

use super::{Measured, Row, Unit};
use crate::error::{Error, Result};
use crate::output::file::write_bytes;

/// A number as its unit has it: "0.042 %", "diverges", "no answer".
pub fn shown(value: f64, unit: Unit) -> String {
    let (value, sign) = if unit == Unit::Percent { (100.0 * value, " %") } else { (value, "") };
    match value {
        v if v.is_nan() => "NaN".into(),
        v if v.is_infinite() => "∞".into(),
        0.0 => format!("0{sign}"),
        v if v.abs() < 1e-3 || v.abs() >= 1e5 => format!("{v:.1e}{sign}"),
        v if v.abs() < 1.0 => format!("{v:.3}{sign}"),
        v if v.fract() == 0.0 => format!("{v}{sign}"),
        v if v.abs() < 100.0 => format!("{v:.2}{sign}"),
        v => format!("{v:.0}{sign}"),
    }
}

const HEAD: [&str; 6] = ["#", "case", "textbook", "glowtree", "limit", "verdict"];

/// The cells of a row: the numbers nearest to their limits, or farthest beyond.
fn cells(row: &Row) -> [String; 6] {
    let number = |m: &Measured| shown(m.value, m.unit);
    let verdict = if row.holds { "holds" } else { "FAIL" };
    [
        row.number.to_string(),
        row.case.into(),
        row.worst_textbook().map_or("–".into(), number),
        row.worst().map_or("–".into(), number),
        row.worst().map_or("–".into(), |m| shown(m.limit, m.unit)),
        verdict.into(),
    ]
}

/// Widths of the columns, in characters, for all that the table may hold.
const WIDTHS: [usize; 6] = [2, 34, 12, 12, 10, 7];

fn line(cells: &[String; 6]) -> String {
    let mut text = String::new();
    for (k, (cell, width)) in cells.iter().zip(WIDTHS).enumerate() {
        let room = " ".repeat(width.saturating_sub(cell.chars().count()));
        // Numbers to the right, words to the left.
        let _ = if [1, 5].contains(&k) { write!(text, "{cell}{room}") } else { write!(text, "{room}{cell}") };
        text += "  ";
    }
    text.truncate(text.trim_end().len());
    text + "\n"
}

/// The first line of the table.
pub fn head() -> String {
    line(&HEAD.map(String::from))
}

/// One row as text: a line of the table, and one for each number that does not hold.
pub fn text(row: &Row) -> String {
    let broken = row.ours.iter().filter(|m| !m.holds());
    let told = broken.map(|m| format!("      {}: {}\n", m.what, shown(m.value, m.unit)));
    line(&cells(row)) + &told.collect::<String>()
}

/// All numbers, one a line.
pub fn csv(rows: &[Row]) -> String {
    let mut text = String::from("row,case,scheme,what,value,limit,unit,holds\n");
    let quoted = |s: &str| format!("\"{}\"", s.replace('"', "\"\""));
    for row in rows {
        let ours = row.ours.iter().map(|m| ("glowtree", m));
        for (scheme, m) in ours.chain(row.textbook.iter().map(|m| (row.scheme.unwrap_or("textbook"), m))) {
            let unit = if m.unit == Unit::Percent { "share" } else { "plain" };
            let (case, what, scheme) = (quoted(row.case), quoted(&m.what), quoted(scheme));
            let (value, limit, holds) = (m.value, m.limit, m.holds());
            let _ =
                writeln!(text, "{},{case},{scheme},{what},{value:e},{limit:e},{unit},{holds}", row.number);
        }
    }
    text
}

/// The table in Markdown, with every number below.
pub fn markdown(rows: &[Row]) -> String {
    let mut text = format!("| {} |\n|---|---|---|---|---|---|\n", HEAD.join(" | "));
    for row in rows {
        let [number, case, textbook, ours, limit, verdict] = cells(row);
        let scheme = row.scheme.map_or(String::new(), |s| format!(" ({s})"));
        let ours = row.worst().map_or(ours.clone(), |m| format!("{ours} ({})", m.what));
        let _ = writeln!(text, "| {number} | {case} | {textbook}{scheme} | {ours} | {limit} | {verdict} |");
    }
    text += "\n| # | what | textbook | glowtree | limit |\n|---|---|---|---|---|\n";
    for row in rows {
        for m in &row.ours {
            let beside = row.textbook.iter().find(|t| t.what == m.what);
            let beside = beside.map_or("–".into(), |t| shown(t.value, t.unit));
            let (value, limit) = (shown(m.value, m.unit), shown(m.limit, m.unit));
            let _ = writeln!(text, "| {} | {} | {beside} | {value} | {limit} |", row.number, m.what);
        }
    }
    text
}

/// Writes `stability.csv` and `stability.md` into a folder, making it.
///
/// # Errors
/// [`Error::Io`].
pub fn write(rows: &[Row], folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "making the folder", e))?;
    for (name, text) in [("stability.csv", csv(rows)), ("stability.md", markdown(rows))] {
        write_bytes(&folder.join(name), text.as_bytes())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(value: f64) -> Row {
        let ours = vec![Measured::share("leak", value, 1e-3), Measured::share("worst", 1e-4, 1e-2)];
        let holds = ours.iter().all(Measured::holds);
        let textbook = vec![Measured::share("leak", f64::INFINITY, 1e-3)];
        Row { number: 5, case: "thin wall", scheme: Some("by distance"), textbook, ours, holds }
    }

    #[test]
    fn rows_that_do_not_hold_say_so() {
        let (good, bad, odd) = (row(5e-4), row(2e-3), row(f64::NAN));
        assert!(good.holds && !bad.holds && !odd.holds);
        assert!(text(&good).contains("holds") && text(&good).lines().count() == 1);
        assert!(text(&bad).contains("FAIL") && text(&bad).contains("leak: 0.200 %"), "{}", text(&bad));
        assert!(text(&odd).contains("NaN") && markdown(&[odd]).contains("FAIL"));
        assert!(csv(&[bad]).contains("5,\"thin wall\",\"glowtree\",\"leak\",2e-3,1e-3,share,false\n"));
    }
}
