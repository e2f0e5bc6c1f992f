"""For sites that come from Nagios: its object files translated, its log compared."""
