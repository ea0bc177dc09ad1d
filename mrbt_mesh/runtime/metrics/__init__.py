"""What operators measure: counted by each robot and by who watches, served to Prometheus."""
