//! Which column of a PLY element means what.

use crate::scene::ply::header::{Element, Kind, Property};
use crate::scene::ply::scalar::Scalar;

/// Places in a row's array of known numbers: position.
pub const POSITION: usize = 0;
/// Normal.
pub const NORMAL: usize = 3;
/// Colour.
pub const COLOUR: usize = 6;
/// Texture coordinates.
pub const UV: usize = 9;
/// How many numbers a row may contribute.
pub const ROLES: usize = 11;

/// Names by role; the first column that bears one of a role's names has it.
const NAMES: [&[&str]; ROLES] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx", "normal_x"],
    &["ny", "normal_y"],
    &["nz", "normal_z"],
    &["red", "r", "diffuse_red"],
    &["green", "g", "diffuse_green"],
    &["blue", "b", "diffuse_blue"],
    &["u", "s", "texture_u", "texcoord_u"],
    &["v", "t", "texture_v", "texcoord_v"],
];

/// What one column is to the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// A number with this role.
    Role(usize),
    /// The list of corner indices.
    Indices,
    /// Not of interest.
    Skipped,
}

/// The uses of an element's columns, in file order.
#[derive(Debug, Clone)]
pub struct Columns {
    /// One per property.
    pub uses: Vec<Use>,
    /// The type of each role's column.
    pub roles: [Option<Scalar>; ROLES],
}

impl Columns {
    /// Finds known names; a role whose triple (or pair) is incomplete is dropped.
    pub fn of(element: &Element) -> Self {
        let mut roles = [None; ROLES];
        let mut uses: Vec<Use> = Vec::with_capacity(element.properties.len());
        for property in &element.properties {
            let found = column_use(property);
            let taken = uses.contains(&found);
            let found = if taken { Use::Skipped } else { found };
            if let (Use::Role(role), Kind::Scalar(scalar)) = (found, property.kind) {
                roles[role] = Some(scalar);
            }
            uses.push(found);
        }
        for group in [POSITION..NORMAL, NORMAL..COLOUR, COLOUR..UV, UV..ROLES] {
            if roles[group.clone()].iter().any(Option::is_none) {
                roles[group.clone()].fill(None);
                for found in &mut uses {
                    if matches!(found, Use::Role(role) if group.contains(role)) {
                        *found = Use::Skipped;
                    }
                }
            }
        }
        Self { uses, roles }
    }

    /// Whether the group that starts at this role is there.
    pub fn has(&self, group: usize) -> bool {
        self.roles[group].is_some()
    }

    /// Whether there is a list of corner indices.
    pub fn has_indices(&self) -> bool {
        self.uses.contains(&Use::Indices)
    }
}

fn column_use(property: &Property) -> Use {
    match property.kind {
        Kind::List { item, .. } => {
            let named = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
            if named && !item.is_float() { Use::Indices } else { Use::Skipped }
        }
        Kind::Scalar(_) => {
            let name = property.name.to_ascii_lowercase();
            NAMES.iter().position(|names| names.contains(&name.as_str())).map_or(Use::Skipped, Use::Role)
        }
    }
}
