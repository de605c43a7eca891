//! The layouts that shaders see equal the Rust records: every offset, reflected from SPIR-V.

use std::collections::BTreeMap;

use cairn_format::gpu::{Field, records};
use cairn_shaders::Shader;

/// Member names and offsets of the structs of a module, by struct name.
type Structs = BTreeMap<String, Vec<(String, u32)>>;

const OP_NAME: u32 = 5;
const OP_MEMBER_NAME: u32 = 6;
const OP_MEMBER_DECORATE: u32 = 72;
const DECORATION_OFFSET: u32 = 35;

/// Opcode and operands of every instruction (SPIR-V specification, section 2.3).
fn instructions(shader: &Shader) -> impl Iterator<Item = (u32, &[u32])> {
    let mut words = &shader.spirv[5..];
    std::iter::from_fn(move || {
        let head = words.first()?;
        let (instruction, rest) = words.split_at((head >> 16) as usize);
        words = rest;
        Some((head & 0xffff, &instruction[1..]))
    })
}

/// Collects `OpName`, `OpMemberName` and `OpMemberDecorate Offset` (SPIR-V specification, section 3.49).
fn structs(shader: &Shader) -> Structs {
    let mut names: BTreeMap<u32, String> = BTreeMap::new();
    let mut members: BTreeMap<(u32, u32), String> = BTreeMap::new();
    let mut offsets: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    for (op, operands) in instructions(shader) {
        match op {
            OP_NAME => {
                names.insert(operands[0], text(&operands[1..]));
            }
            OP_MEMBER_NAME => {
                members.insert((operands[0], operands[1]), text(&operands[2..]));
            }
            OP_MEMBER_DECORATE if operands[2] == DECORATION_OFFSET => {
                offsets.insert((operands[0], operands[1]), operands[3]);
            }
            _ => {}
        }
    }
    let mut structs = Structs::new();
    for ((id, member), offset) in offsets {
        let name = names.get(&id).cloned().unwrap_or_default();
        let field = members.get(&(id, member)).cloned().unwrap_or_default();
        structs
            .entry(format!("{name}#{id}"))
            .or_default()
            .push((field, offset));
    }
    structs
}

fn text(words: &[u32]) -> String {
    let bytes: Vec<u8> = words
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .take_while(|byte| *byte != 0)
        .collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn expected(fields: &[Field]) -> Vec<(String, u32)> {
    fields
        .iter()
        .map(|field| (field.name.to_owned(), field.offset as u32))
        .collect()
}

fn layout_probe() -> &'static Shader {
    cairn_shaders::ALL
        .iter()
        .find(|shader| shader.name.contains("layout"))
        .expect("the layout probe")
}

#[test]
fn the_probe_holds_every_record() {
    let found = structs(layout_probe());
    for (name, _, fields) in records() {
        let of_name = found
            .iter()
            .filter(|(key, _)| key.split('#').next() == Some(name));
        let layouts: Vec<_> = of_name.map(|(_, layout)| layout).collect();
        assert!(!layouts.is_empty(), "no {name} in the layout probe");
        for layout in layouts {
            assert_eq!(*layout, expected(fields), "{name}");
        }
    }
}

#[test]
fn every_shader_agrees_on_the_records_it_uses() {
    let mut seen = 0;
    for shader in cairn_shaders::ALL {
        for (key, layout) in structs(shader) {
            let name = key.split('#').next().unwrap_or_default();
            if let Some((_, _, fields)) = records().into_iter().find(|record| record.0 == name) {
                assert_eq!(layout, expected(fields), "{name} in {}", shader.name);
                seen += 1;
            }
        }
    }
    assert!(seen > records().len(), "only {seen} records were compared");
}

/// Array strides of the records in the probe's buffers equal the Rust sizes.
#[test]
fn strides_equal_sizes() {
    const OP_DECORATE: u32 = 71;
    const ARRAY_STRIDE: u32 = 6;
    const OP_TYPE_RUNTIME_ARRAY: u32 = 29;
    let shader = layout_probe();
    let (mut strides, mut arrays, mut names) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    for (op, operands) in instructions(shader) {
        match op {
            OP_DECORATE if operands[1] == ARRAY_STRIDE => {
                strides.insert(operands[0], operands[2]);
            }
            OP_TYPE_RUNTIME_ARRAY => {
                arrays.insert(operands[0], operands[1]);
            }
            OP_NAME => {
                names.insert(operands[0], text(&operands[1..]));
            }
            _ => {}
        }
    }
    let mut compared = 0;
    for (array, element) in arrays {
        let name: &String = &names[&element];
        let (_, size, _) = records()
            .into_iter()
            .find(|record| record.0 == name)
            .expect("arrays hold records");
        assert_eq!(strides[&array] as usize, size, "stride of {name}");
        compared += 1;
    }
    assert!(
        compared >= 8,
        "only {compared} arrays of records in the probe"
    );
}
