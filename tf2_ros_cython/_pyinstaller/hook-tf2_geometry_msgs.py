from tf2_ros_cython._pyinstaller import hidden_imports

hiddenimports = hidden_imports("tf2_geometry_msgs")
