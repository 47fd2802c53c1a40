//! Vectors and matrices as plain arrays in files: `[x, y]` and `[[xx, xy], [yx, yy]]` (rows).

/// For `#[serde(with = "…")]` on a `Vector2<f64>`.
pub(crate) mod vector {
    use nalgebra::Vector2;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(vector: &Vector2<f64>, serializer: S) -> Result<S::Ok, S::Error> {
        [vector.x, vector.y].serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vector2<f64>, D::Error> {
        let [x, y] = <[f64; 2]>::deserialize(deserializer)?;
        Ok(Vector2::new(x, y))
    }
}

/// For `#[serde(with = "…")]` on a `Matrix2<f64>`.
pub(crate) mod matrix {
    use nalgebra::Matrix2;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(matrix: &Matrix2<f64>, serializer: S) -> Result<S::Ok, S::Error> {
        [[matrix.m11, matrix.m12], [matrix.m21, matrix.m22]].serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Matrix2<f64>, D::Error> {
        let [[xx, xy], [yx, yy]] = <[[f64; 2]; 2]>::deserialize(deserializer)?;
        Ok(Matrix2::new(xx, xy, yx, yy))
    }
}
