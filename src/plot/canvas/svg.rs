//! A page as SVG: text stays text, pictures are embedded.

use std::fmt::Write;

use super::{Anchor, At, Colour, Figure, Mark, Pen, Text, font};

/// The whole file.
pub fn text(figure: &Figure) -> String {
    let (width, height) = (number(figure.width), number(figure.height));
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"{}\">\n<title>{}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n",
        font::FAMILY,
        escaped(&figure.title)
    );
    for (index, mark) in figure.marks.iter().enumerate() {
        out.push_str(&written(mark, index));
        out.push('\n');
    }
    out.push_str("</svg>\n");
    out
}

fn written(mark: &Mark, index: usize) -> String {
    match mark {
        Mark::Line { points, pen } => {
            format!("<polyline points=\"{}\" fill=\"none\" {}/>", listed(points), stroke(pen))
        }
        Mark::Area { points, fill } => format!("<polygon points=\"{}\" {}/>", listed(points), filled(*fill)),
        Mark::Disc { centre: [x, y], radius, fill, edge } => {
            let edge = edge.as_ref().map_or(String::new(), |pen| format!(" {}", stroke(pen)));
            let [x, y, radius] = [*x, *y, *radius].map(number);
            format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" {}{edge}/>", filled(*fill))
        }
        Mark::Text(text) => lettered(text),
        Mark::Picture { place, picture } => {
            let [x, y, width, height] =
                [place.low[0], place.low[1], place.width(), place.height()].map(number);
            let data = super::bitmap::encoded(picture.width, picture.height, &picture.bytes)
                .map_or(String::new(), |bytes| base64(&bytes));
            format!(
                "<image x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" preserveAspectRatio=\"none\" \
                 href=\"data:image/png;base64,{data}\"/>"
            )
        }
        Mark::Begin { name, clip: None } => format!("<g class=\"{}\">", escaped(name)),
        Mark::Begin { name, clip: Some(clip) } => format!(
            "<clipPath id=\"clip{index}\"><polygon points=\"{}\"/></clipPath>\n<g class=\"{}\" clip-path=\"url(#clip{index})\">",
            listed(&clip.corners()),
            escaped(name)
        ),
        Mark::End => "</g>".to_owned(),
    }
}

fn lettered(text: &Text) -> String {
    let anchor = match text.anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    let [x, y] = text.at.map(number);
    let turn = if text.upwards { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
    format!(
        "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" text-anchor=\"{anchor}\" {}{turn}>{}</text>",
        number(text.size),
        filled(text.colour),
        escaped(&text.text)
    )
}

fn listed(points: &[At]) -> String {
    let mut out = String::new();
    for (k, [x, y]) in points.iter().enumerate() {
        let space = if k > 0 { " " } else { "" };
        // Writing to a String cannot fail.
        let _ = write!(out, "{space}{},{}", number(*x), number(*y));
    }
    out
}

fn hex(colour: Colour) -> String {
    format!("#{:02x}{:02x}{:02x}", colour.red, colour.green, colour.blue)
}

fn filled(colour: Colour) -> String {
    let veil = veil("fill", colour);
    format!("fill=\"{}\"{veil}", hex(colour))
}

fn stroke(pen: &Pen) -> String {
    let dash = pen
        .dash
        .map_or(String::new(), |[on, off]| format!(" stroke-dasharray=\"{} {}\"", number(on), number(off)));
    let veil = veil("stroke", pen.colour);
    format!(
        "stroke=\"{}\"{veil} stroke-width=\"{}\" stroke-linejoin=\"round\"{dash}",
        hex(pen.colour),
        number(pen.width)
    )
}

fn veil(what: &str, colour: Colour) -> String {
    if colour.alpha == 255 {
        return String::new();
    }
    format!(" {what}-opacity=\"{}\"", number(f64::from(colour.alpha) / 255.0))
}

/// Two decimals, a hundredth of a unit, as few letters as it takes.
fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Text without what XML takes for its own or does not allow.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

const SIXTY_FOUR: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Bytes as RFC 4648 has them.
fn base64(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |k: usize| u32::from(three.get(k).copied().unwrap_or(0));
        let word = byte(0) << 16 | byte(1) << 8 | byte(2);
        for k in 0..4 {
            let sign = SIXTY_FOUR[(word >> (18 - 6 * k) & 63) as usize];
            out.push(if k <= three.len() { char::from(sign) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::palette;

    #[test]
    fn base64_is_that_of_the_rfc() {
        // RFC 4648, section 10.
        for (plain, coded) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn numbers_are_short_and_text_is_safe() {
        assert_eq!(
            [1.0, 0.126, -0.001, 1234.5678].map(number),
            ["1", "0.13", "0", "1234.57"].map(String::from)
        );
        assert_eq!(escaped("a<b & \"c\"\u{1}"), "a&lt;b &amp; &quot;c&quot; ");
    }

    #[test]
    fn marks_come_out_in_order() {
        let mut figure = Figure::new([10.0, 5.0], "t<");
        figure.group("g", Some(figure.page()), |f| {
            f.line(&[[0.0, 0.0], [1.0, 2.0]], Pen::new(palette::INK, 1.0));
        });
        figure.disc([1.0, 1.0], 2.0, palette::PAPER.veiled(51), None);
        let text = figure.svg();
        let places = [
            "<title>t&lt;",
            "<clipPath",
            "<g class=\"g\"",
            "<polyline",
            "</g>",
            "fill-opacity=\"0.2\"",
            "</svg>",
        ]
        .map(|part| text.find(part).unwrap_or_else(|| panic!("{part}: {text}")));
        assert!(places.is_sorted(), "{places:?}");
    }
}
