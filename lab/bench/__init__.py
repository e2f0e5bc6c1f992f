"""What a part of the exporter costs on this machine: `./run bench` lists the measurements."""
