//! Where a robot is, in Rust: cargo run -- [ROBOT [ENDPOINT]]

use serde::Deserialize;

// Only the fields that are wanted; serde passes over the others, and those that are missing are 0.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Point {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Pose {
    position: Point,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct PoseWithCovariance {
    pose: Pose,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Odometry {
    pose: PoseWithCovariance,
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let mut arguments = std::env::args().skip(1);
    let robot = arguments.next().unwrap_or_else(|| "r1".into());
    let endpoint = arguments.next().unwrap_or_else(|| "tcp/127.0.0.1:7447".into());

    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"client\"")?;
    config.insert_json5("connect/endpoints", &format!("[\"{endpoint}\"]"))?;
    let session = zenoh::open(config).await?;
    let odometry = session.declare_subscriber(format!("{robot}/odom")).await?;
    while let Ok(sample) = odometry.recv_async().await {
        let message: Odometry = rmp_serde::from_slice(&sample.payload().to_bytes())?;
        let Point { x, y, z } = message.pose.pose.position;
        println!("{x:.3} {y:.3} {z:.3}");
    }
    Ok(())
}
