//! The statements of a material library (MTL) that a diffuse solver needs; all others are passed over.

use crate::light::Rgb;

/// One `newmtl` and what follows it, as written.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Written {
    /// Its name.
    pub name: String,
    /// `Kd`.
    pub albedo: Option<Rgb>,
    /// `Ke`.
    pub radiance: Option<Rgb>,
    /// `map_Kd`, options included.
    pub texture: Option<String>,
    /// Whether `illum`, `d` or `Tr` make it a mirror or glass.
    pub beyond_diffuse: bool,
}

/// Reads a library. Statements before the first `newmtl` belong to nothing.
///
/// # Errors
/// Line and problem as text.
pub fn read(text: &str) -> Result<Vec<Written>, String> {
    let mut materials: Vec<Written> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let (keyword, rest) = line.trim().split_once([' ', '\t']).unwrap_or((line.trim(), ""));
        if keyword == "newmtl" {
            materials.push(Written { name: rest.trim().to_string(), ..Written::default() });
        } else if let Some(material) = materials.last_mut() {
            material.statement(keyword, rest.trim()).map_err(|p| format!("line {}: {p}", number + 1))?;
        }
    }
    Ok(materials)
}

impl Written {
    fn statement(&mut self, keyword: &str, rest: &str) -> Result<(), String> {
        let first = || number(rest.split_ascii_whitespace().next().unwrap_or_default());
        match keyword {
            "Kd" => self.albedo = colour(rest)?,
            "Ke" => self.radiance = colour(rest)?,
            "map_Kd" => self.texture = Some(rest.to_string()),
            "illum" => self.beyond_diffuse |= first()? >= 3.0,
            "d" if !rest.starts_with('-') => self.beyond_diffuse |= first()? < 1.0,
            "Tr" => self.beyond_diffuse |= first()? > 0.0,
            _ => {}
        }
        Ok(())
    }
}

/// A number as written; what is not finite is refused with the material that uses it.
fn number(word: &str) -> Result<f64, String> {
    word.parse().map_err(|_| format!("{word:?} is no number"))
}

/// Three channels, or one for all of them; nothing for spectral files and CIE coordinates.
fn colour(rest: &str) -> Result<Option<Rgb>, String> {
    if rest.starts_with("spectral") || rest.starts_with("xyz") {
        return Ok(None);
    }
    let numbers = rest.split_ascii_whitespace().map(number).collect::<Result<Vec<f64>, _>>()?;
    match numbers[..] {
        [grey] => Ok(Some(Rgb::splat(grey as f32))),
        [r, g, b, ..] => Ok(Some(Rgb::new(r as f32, g as f32, b as f32))),
        _ => Err(format!("a colour of {} numbers", numbers.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_diffuse_solver_needs_is_read() {
        let text = "Kd 9 9 9\n# a comment\nnewmtl a wall\r\nKd 0.5\r\n\tKe 1 2 3\nNs 96\nillum 2\nd 1\n\
                    newmtl glass\nd 0.5\nmap_Kd -s 1 1 1 a b.png\nnewmtl odd\nKd spectral a.rfl\nTr 0.5\nmap_d x.png\n";
        let read = read(text).unwrap();
        assert_eq!(read.iter().map(|m| &m.name[..]).collect::<Vec<_>>(), ["a wall", "glass", "odd"]);
        assert_eq!(
            (read[0].albedo, read[0].radiance),
            (Some(Rgb::splat(0.5)), Some(Rgb::new(1.0, 2.0, 3.0)))
        );
        assert_eq!(read.iter().map(|m| m.beyond_diffuse).collect::<Vec<_>>(), [false, true, true]);
        assert_eq!(read[1].texture.as_deref(), Some("-s 1 1 1 a b.png"));
        assert_eq!((read[2].albedo, &read[2].texture), (None, &None));
    }

    #[test]
    fn broken_statements_are_refused_by_line() {
        for (text, said) in [
            ("newmtl a\nKd\n", "line 2: a colour of 0 numbers"),
            ("newmtl a\n\nKd 1 2\n", "line 3: a colour of 2 numbers"),
            ("newmtl a\nKe 0 zero 0\n", "line 2: \"zero\" is no number"),
            ("newmtl a\nillum\n", "line 2: \"\" is no number"),
        ] {
            assert_eq!(read(text).unwrap_err(), said);
        }
    }
}
