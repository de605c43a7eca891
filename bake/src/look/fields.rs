//! Records as JSON, by the fields that they declare: what a record gains shows without a change here.

use cairn_format::gpu::Field;
use serde_json::{Map, Value};

/// The fields of one record by name, padding left out; floats that JSON cannot hold become text.
pub fn record_values(fields: &[Field], record: &[u8]) -> Map<String, Value> {
    let visible = fields
        .iter()
        .filter(|field| !field.name.starts_with("pad_"));
    visible
        .map(|field| {
            let bytes = &record[field.offset..][..field.bytes()];
            (field.name.to_owned(), value(field, bytes))
        })
        .collect()
}

fn value(field: &Field, bytes: &[u8]) -> Value {
    let mut numbers: Vec<Value> = match field.glsl {
        "uint64_t" => {
            let words = bytes.as_chunks::<8>().0.iter();
            words.map(|word| u64::from_le_bytes(*word).into()).collect()
        }
        _ => {
            let words = bytes
                .as_chunks::<4>()
                .0
                .iter()
                .map(|word| u32::from_le_bytes(*word));
            let number = |word| {
                if field.is_float() {
                    float(f32::from_bits(word))
                } else {
                    word.into()
                }
            };
            words.map(number).collect()
        }
    };
    if numbers.len() == 1 {
        numbers.remove(0)
    } else {
        Value::Array(numbers)
    }
}

/// The shortest decimal that reads back as the same `f32`.
pub(super) fn float(value: f32) -> Value {
    let text = value.to_string();
    let number: Option<f64> = text.parse().ok();
    number
        .map_or(Value::Null, Value::from)
        .as_f64()
        .map_or(Value::String(text), Value::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_format::gpu::{Instance, Material, Record};

    #[test]
    fn fields_have_their_names_and_values() {
        let material = Material {
            metallic_factor: 0.1,
            roughness_factor: f32::NAN,
            alpha_mode: 2,
            ..Material::default()
        };
        let values = record_values(Material::FIELDS, bytemuck::bytes_of(&material));
        assert_eq!(values["metallic_factor"], 0.1);
        assert_eq!(values["roughness_factor"], "NaN");
        assert_eq!(values["alpha_mode"], 2);
        assert_eq!(
            values["base_color_factor"],
            serde_json::json!([1.0, 1.0, 1.0, 1.0])
        );
        assert_eq!(values.len(), Material::FIELDS.len());
        let record = [0; size_of::<Instance>()];
        assert!(!record_values(Instance::FIELDS, &record).contains_key("pad_116"));
    }
}
