"""Task policies and expectations: from the emulator, from NAF, or exact."""
