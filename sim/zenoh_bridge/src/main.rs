//! zenoh-bridge-ros2dds as demo and tests need it: Eclipse's plugin in a runtime of zenoh.
//!
//! usage: zenoh-bridge CONFIG.json5, the config of zenoh-bridge-ros2dds; RUST_LOG=info logs.

use std::error::Error;

use zenoh::{
    config::Config,
    internal::{plugins::PluginsManager, runtime::RuntimeBuilder},
};
use zenoh_plugin_ros2dds::ROS2Plugin;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    zenoh::init_log_from_env_or("warn");
    let path = std::env::args().nth(1).ok_or("usage: zenoh-bridge CONFIG.json5")?;
    let mut config = Config::from_file(path)?;
    config.insert_json5("plugins/ros2dds/__required__", "true")?;
    let mut plugins = PluginsManager::static_plugins_only();
    plugins.declare_static_plugin::<ROS2Plugin, &str>("ros2dds", true);
    let mut runtime = RuntimeBuilder::new(config).plugins_manager(plugins).build().await?;
    runtime.start().await?;
    println!("ready");
    std::future::pending().await
}
